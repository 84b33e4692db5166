// The subcommand `stability` of shearbus-study: runs the stability campaign and writes tables, JSON and a picture.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tests/campaign/user_scene.hpp"
#include "tests/study/command.hpp"

namespace shearbus::study {

// Options of the subcommand. If a scene is given, the rows run on the physics of this scene only. Invalid requests
// (refusals) and wrong solvers (controls) do not depend on a scene and then do not run.
struct StabilityOptions : CommandOptions {
  std::string row;           // name of the only row to run; empty: all rows, refusals and controls
  std::optional<int> steps;  // upper bound of the number of steps of a row
  long random_steps = 200000;
  std::uint64_t seed = 1;
  bool only_random = false;  // true: only random histories run
  HostGiven host;            // properties of the host, if a scene is given
};

// Adds the subcommand "stability" to the program.
CLI::App* add_stability(CLI::App& program, StabilityOptions& options);

// Returns 0 if all invariants held, all invalid requests were refused and all wrong solvers failed, otherwise 1. A row
// that does not reach its regime counts as a fault of the campaign, except with a scene of the user or with fewer
// steps.
int run_stability(const StabilityOptions& options);

}  // namespace shearbus::study
