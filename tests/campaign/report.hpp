// The stability campaign as a user runs it: tables, JSON, picture.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tests/campaign/user_scene.hpp"
#include "tests/study/command.hpp"

namespace shearbus::study {

// With a scene its physics alone, and neither refusals nor controls, which do not depend on it.
struct StabilityOptions : CommandOptions {
  std::string row;           // only this one; empty: all, and refusals and controls
  std::optional<int> steps;  // of each row at most
  long random_steps = 200000;
  std::uint64_t seed = 1;
  bool only_random = false;  // no rows, refusals and controls
  HostGiven host;            // of the scene
};

// Adds the subcommand "stability" to the program.
CLI::App* add_stability(CLI::App& program, StabilityOptions& options);

// 0 where everything held, was refused or was seen to fail as it must; 1 otherwise. A row that does not come to what it
// is for is a fault of the campaign, but not of a scene or of a run cut short.
int run_stability(const StabilityOptions& options);

}  // namespace shearbus::study
