// The error and the cost of each option of a model: one row for every option of server/physics/solver/parts_table.hpp and for
// every law, with each strategy that allows it. A new option gets its rows without an edit here.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace shearbus::study {

struct OptionError {
  bool sdirk2;
  int steps;
  double temperature_error;  // largest |T0 - reference|, relative to T_melt minus the initial temperature
};

struct OptionRow {
  std::string option;                          // key of a scene or name of a law; empty: the case without any
  std::string strategy;                        // "velocity-driven" or "force-driven"
  std::string companion;                       // a further option that this one needs; empty: none
  double space_error = 0.0, time_error = 0.0;  // of the reference
  std::vector<OptionError> errors;
};

// Solves the paper's case with each option on 30 cells that grow by 1.25: 1 us at 11.2 GPa, under 100 m/s where the jump
// drives the layer, else 300 m/s, so that the interface comes to melting. With `quick` the references are coarse.
std::vector<OptionRow> option_rows(bool quick);

std::string table(const std::vector<OptionRow>& rows);
nlohmann::ordered_json json(const std::vector<OptionRow>& rows);

}  // namespace shearbus::study
