// shearbus-map SCENE.toml --out DIR: see README.md beside this file.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "client/map/output.hpp"
#include "client/map/sweep.hpp"
#include "proto/scene/reader.hpp"

namespace {

constexpr int kRunError = 1;
constexpr int kUsageError = 2;
constexpr double kWhole = 1e-6;  // relative: an observation this near to a step's end is at it

struct Options {
  std::filesystem::path scene;
  std::filesystem::path out;
  std::vector<double> pressures_pa{1e9, 100e9};
  std::vector<double> velocities_m_per_s{1.0, 1000.0};
  std::size_t num_pressures = 33;
  std::size_t num_velocities = 49;
  std::vector<double> times_s{0.1e-6, 0.3e-6, 1e-6, 3e-6};
  double dt_s = 1e-9;
};

void describe(CLI::App& app, Options& options) {
  app.set_version_flag("--version", std::string("shearbus-map ") + SHEARBUS_VERSION);
  app.add_option("SCENE.toml", options.scene, "velocity-driven scene: materials and layer")->required()->type_name("");
  app.add_option("--out", options.out, "directory for nodes.csv and map.json")->required()->type_name("DIR");
  app.add_option("--pressure", options.pressures_pa, "lowest and highest pressure, in Pa")
      ->expected(2)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--velocity", options.velocities_m_per_s, "lowest and highest velocity jump, in m/s")
      ->expected(2)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--pressures", options.num_pressures, "how many, at equal ratios")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app.add_option("--velocities", options.num_velocities, "how many, at equal ratios")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app.add_option("--times", options.times_s, "observation times, in s, increasing")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--dt", options.dt_s, "step, in s")->check(CLI::PositiveNumber)->capture_default_str();
  app.footer("What the lines mean and how to draw them: client/map/README.md");
}

std::string fault_of(const Options& options) {
  for (const auto* range : {&options.pressures_pa, &options.velocities_m_per_s})
    if (!((*range)[0] < (*range)[1])) return "--pressure and --velocity want the lower value first";
  double before = 0.0;
  for (const double time : options.times_s) {
    const double steps = time / options.dt_s;
    if (!(time > before)) return fmt::format("--times must increase, found {:g} after {:g} s", time, before);
    if (std::abs(steps - std::round(steps)) > kWhole * steps || steps < 0.5)
      return fmt::format("--times: {:g} s is not a whole number of steps of {:g} s", time, options.dt_s);
    before = time;
  }
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Maps the velocity-driven model over pressure and velocity: where its layer sticks, slips and melts.",
               "shearbus-map");
  describe(app, options);
  try {
    app.parse(argc, argv);
    if (const std::string fault = fault_of(options); !fault.empty()) throw CLI::ValidationError(fault);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }
  using namespace shearbus;  // NOLINT(google-build-using-namespace)
  try {
    const auto range = [](const std::vector<double>& ends, std::size_t count) {
      return map::log_spaced(ends[0], ends[1], count);
    };
    const map::Map made = map::sweep(
        {.text = scene::load_text(options.scene), .file = options.scene.string()},
        {range(options.pressures_pa, options.num_pressures), range(options.velocities_m_per_s, options.num_velocities)},
        options.times_s, options.dt_s);
    for (const std::string& warning : made.warnings) fmt::print(stderr, "shearbus-map: warning: {}\n", warning);
    map::write(made, made.scene_name, SHEARBUS_VERSION, options.out);
    fmt::print("{}{}: nodes.csv, map.json\n", map::summary(made), options.out.string());
    return 0;
  } catch (const Error& fault) {
    fmt::print(stderr, "shearbus-map: {}\n", fault.status().text);
    return kRunError;
  } catch (const std::exception& fault) {
    fmt::print(stderr, "shearbus-map: {}\n", fault.what());
    return kRunError;
  }
}
