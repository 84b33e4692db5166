#include "tests/study/map/command.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <string>

#include "proto/program/program.hpp"
#include "proto/scene/reader.hpp"
#include "proto/wire/text.hpp"
#include "tests/study/map/output.hpp"
#include "tests/study/map/sweep.hpp"

namespace shearbus::map {
namespace {

constexpr double kMostSteps = 1e9;
constexpr double kWhole = 1e-6;  // a time of observation may differ by this share from a whole number of steps

// Returns a message about the first fault in the ranges or in the times of observation, or an empty text if there is
// none.
std::string fault_of(const CommandOptions& options) {
  for (const auto* range : {&options.pressures_pa, &options.velocities_m_per_s})
    if (!((*range)[0] < (*range)[1])) return "--pressure and --velocity want the lower value first";
  double before = 0.0;
  for (const double time : options.times_s) {
    const double steps = time / options.dt_s;
    if (!(time > before)) return fmt::format("--times must increase, found {:g} after {:g} s", time, before);
    if (!(steps <= kMostSteps))
      return fmt::format("--times: {:g} s is {:g} steps of {:g} s, expected at most {:g}", time, steps, options.dt_s,
                         kMostSteps);
    if (std::abs(steps - std::round(steps)) > kWhole * steps || steps < 0.5)
      return fmt::format("--times: {:g} s is not a whole number of steps of {:g} s", time, options.dt_s);
    before = time;
  }
  return {};
}

}  // namespace

CLI::App* add_command(CLI::App& program, CommandOptions& options) {
  CLI::App* command = program.add_subcommand(
      "map", "The velocity-driven model over pressure and velocity: where its layer sticks, slips and melts");
  command->add_option("scene", options.scene, "velocity-driven scene: materials and layer")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("--out", options.out, "directory for nodes.csv and map.json")->required()->type_name("DIR");
  command->add_option("--pressure", options.pressures_pa, "lowest and highest pressure, in Pa")
      ->expected(2)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--velocity", options.velocities_m_per_s, "lowest and highest velocity jump, in m/s")
      ->expected(2)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--pressures", options.num_pressures, "how many, at equal ratios")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  command->add_option("--velocities", options.num_velocities, "how many, at equal ratios")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  command->add_option("--times", options.times_s, "observation times, in s, increasing")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--dt", options.dt_s, "step, in s")->check(CLI::PositiveNumber)->capture_default_str();
  command->footer("What the lines mean and how to draw them: tests/study/map/README.md");
  command->callback([&options] {
    if (const std::string fault = fault_of(options); !fault.empty()) throw CLI::ValidationError(fault);
  });
  return command;
}

void run(const CommandOptions& options) {
  const SceneText scene{.text = scene::load_text(options.scene), .file = options.scene.string()};
  const Axes axes{log_spaced(options.pressures_pa[0], options.pressures_pa[1], options.num_pressures),
                  log_spaced(options.velocities_m_per_s[0], options.velocities_m_per_s[1], options.num_velocities)};
  const Map map = sweep(scene, axes, options.times_s, options.dt_s);
  for (const std::string& warning : map.warnings) fmt::print(stderr, "shearbus-study: {}\n", wire::labelled(warning));
  write(map, map.scene_name, server::provenance("shearbus-study", map.scene_name, options.arguments), options.out);
  fmt::print("{}{}: nodes.csv, map.json\n", summary(map), program::shown(options.out));
}

}  // namespace shearbus::map
