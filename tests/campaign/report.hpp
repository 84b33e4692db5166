// The subcommand `stability` of shearbus-study: runs the stability campaign and writes tables, JSON and a picture.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "client/study/command.hpp"
#include "tests/campaign/user_scene.hpp"

namespace shearbus::study {

// Options of the subcommand. A row of the campaign is a load history. With a scene, the rows run on its physics only;
// deliberately wrong solvers (controls) do not depend on a scene and then do not run.
struct StabilityOptions : CommandOptions {
  std::string row;           // name of the only load history to run; empty: all of them and controls
  std::optional<int> steps;  // upper bound of the number of steps of a load history
  long random_steps = 200000;
  std::uint64_t seed = 1;
  bool only_random = false;  // true: only random histories run
  HostGiven host;            // pressure, zone width and step length of the host, if a scene is given
};

// Adds the subcommand "stability" to the program.
CLI::App* add_stability(CLI::App& program, StabilityOptions& options);

// Returns 0 if all invariants held and all deliberately wrong solvers failed, otherwise 1. A load history that does not reach the regime it is meant for counts as a fault of the campaign, unless
// it runs on a scene of the user or is shortened by `steps`.
int run_stability(const StabilityOptions& options);

}  // namespace shearbus::study
