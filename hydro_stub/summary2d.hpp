// The summary of a two-dimensional run, as text and as summary.json.
#pragma once

#include <string>
#include <vector>

#include "hydro_stub/interface_history.hpp"
#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/problem2d.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

struct RunTime2d {
  double total = 0.0;   // wall-clock time  [s]
  double output = 0.0;  // time spent writing results  [s]
  double cpu = 0.0;     // CPU time of all threads of the process  [s]
  LawTime law;
  double service_share() const { return std::chrono::duration<double>(law.service).count() / total; }
  double waiting_share() const { return std::chrono::duration<double>(law.waited).count() / total; }
  double cpu_share() const { return std::chrono::duration<double>(law.cpu).count() / cpu; }
};

struct Summary2d {
  std::string scene;
  std::string interface_law;
  server::Entries provenance;
  const lagrange::Cycle& cycle;
  const lagrange::Ledger& start;
  const InterfaceHistory& interface;
  std::vector<double> start_temperature;  // of each node's layer, where it is not that of the scene  [K]
  std::vector<double> layer_thickness;    // of each node's layer, where it is not that of the scene  [m]
  std::optional<InterfaceStrength> strength;
  std::optional<Envelope> published;
  std::vector<Comparison> comparisons;
  RunTime2d time;
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
