// The stability campaign as a user runs it: tables, JSON, picture.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace shearbus::study {

struct StabilityOptions {
  std::filesystem::path out = "out/study";
  std::string row;  // only this one; empty: all, and refusals and controls
  long random_steps = 200000;
  std::uint64_t seed = 1;
  bool only_random = false;  // no rows, refusals and controls
  bool plot = true;
};

// Adds the subcommand "stability" to the program.
CLI::App* add_stability(CLI::App& program, StabilityOptions& options);

// 0 where everything held, was refused or was seen to fail as it must; 1 otherwise.
int run_stability(const StabilityOptions& options);

}  // namespace shearbus::study
