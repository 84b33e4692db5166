// The summary of a two-dimensional run, as text and as summary.json.
#pragma once

#include <string>
#include <vector>

#include "hydro_stub/interface_history.hpp"
#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/problem2d.hpp"
#include "hydro_stub/summary_json.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

struct Summary2d {
  std::string scene;
  std::string interface_law;
  server::Entries provenance;
  const Problem2d& problem;
  const lagrange::Cycle& cycle;
  const lagrange::Ledger& start;
  const InterfaceHistory& interface;
  std::vector<Comparison> comparisons;
  RunTime time;
  OmittedCost omitted = {};  // options left off and the memory they would need

  std::string text() const;
  std::string json() const;

  std::string displacement_text() const;
  std::string strength_text() const;
  std::string flank_text() const;  // the part of text() on an interface
  // Free slip has the regime code of Coulomb friction, with a limit of 0, and a name of its own.
  bool slips_freely() const { return interface_law == "free_slip"; }
  const char* sliding_name() const { return slips_freely() ? "free slip" : "Coulomb"; }
};

}  // namespace shearbus::hydro
