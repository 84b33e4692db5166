// The subcommand `map` of shearbus-study: the range of pressures and velocities in which the velocity-driven model is
// valid.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace CLI {
class App;
}

namespace shearbus::map {

struct CommandOptions {
  std::filesystem::path scene;
  std::filesystem::path out;
  std::vector<double> pressures_pa{1e9, 100e9};         // lowest and highest pressure of the map
  std::vector<double> velocities_m_per_s{1.0, 1000.0};  // lowest and highest velocity jump of the map
  std::size_t num_pressures = 33;
  std::size_t num_velocities = 49;
  std::vector<double> times_s{0.1e-6, 0.3e-6, 1e-6, 3e-6};  // times at which the nodes are observed, increasing
  double dt_s = 1e-9;
  std::span<const char* const> arguments;  // the command line
};

// Adds the subcommand `map` to the program. Parsing throws CLI::ValidationError if ranges or times are inconsistent.
CLI::App* add_command(CLI::App& program, CommandOptions& options);

// Runs the sweep, writes nodes.csv and map.json to `options.out` and prints a summary. Throws wire::Error for a scene
// that a server refuses or that is not velocity-driven with drive = "layer_shear".
void run(const CommandOptions& options);

}  // namespace shearbus::map
