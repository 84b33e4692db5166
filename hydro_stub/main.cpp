// shearbus-hydro: scene -> problem and interface law -> run -> results.
#include <fmt/format.h>

#include <cctype>
#include <exception>

#include "hydro_stub/cone_run.hpp"
#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/options.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/run.hpp"
#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::hydro {
namespace {

std::filesystem::path output_directory(const Options& options, const wire::Scene& scene) {
  if (!options.out.empty()) return options.out;
  std::string plain = scene.name;
  for (char& c : plain) c = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '-' ? c : '_';
  return std::filesystem::path("out") / fmt::format("{}-{}", plain, name(scene.hydro->interface_law));
}

void carry_out_cone_target(const Options& options, const wire::SceneFile& file) {
  const wire::Scene& scene = file.scene;
  const ConeTarget problem = make_cone_target(scene);
  lagrange::Bodies bodies = make_bodies(problem);
  const std::vector<double> temperature(interface_nodes(bodies), scene.layer.initial_temperature_k);
  const std::unique_ptr<InterfaceLaw> law = make_law(scene, problem.soft, problem.hard, temperature, options.server);
  if (options.check) {
    fmt::print("{}: in order; {} zones, {} interface nodes, interface law {}\n", file.file, bodies.mesh.num_zones(),
               temperature.size(), name(scene.hydro->interface_law));
    return;
  }
  const std::filesystem::path out = output_directory(options, scene);
  run_cone_target(scene, problem, std::move(bodies), *law, out, options.progress);
  if (options.plot) plot_cone(out);
  fmt::print("  {:<24}{}\n", "results", out.string());
}

void carry_out(const Options& options, wire::SceneFile& file) {
  wire::Scene& scene = file.scene;
  if (options.interface_law && scene.hydro) scene.hydro->interface_law = *options.interface_law;
  if (scene.hydro && scene.hydro->cone_target) return carry_out_cone_target(options, file);
  const Problem problem = make_problem(scene);
  const std::unique_ptr<InterfaceLaw> law =
      make_law(scene, problem.soft_material, problem.hard_material, problem.initial_temperature, options.server);
  if (options.check) {
    fmt::print("{}: in order; {} columns, {} steps of {:.6g} ns, interface law {}\n", file.file, problem.columns,
               problem.steps, problem.dt * 1e9, name(scene.hydro->interface_law));
    return;
  }
  const std::filesystem::path out = output_directory(options, scene);
  run(scene, problem, *law, out, options.progress);
  if (options.plot) plot(out);
  fmt::print("  {:<24}{}\n", "results", out.string());
}

int shearbus_hydro(int argc, char** argv) {
  wire::SceneFile file;
  try {
    const CommandLine line = parse_command_line(argc, argv);
    if (line.exit_code) return *line.exit_code;
    file = wire::load_scene_file(line.options.scene);
    carry_out(line.options, file);
    return 0;
  } catch (const wire::Error& error) {
    // What a server refuses names a field of the scene: say where in the file it stands.
    const bool of_scene =
        !error.status().field.empty() && error.status().code == wire::Code::kInvalidScene && !file.file.empty();
    const std::string place = of_scene ? file.where(error.status().field) + ": " : "";
    fmt::print(stderr, "shearbus-hydro: {}{}\n", place, error.what());
  } catch (const std::exception& error) {
    fmt::print(stderr, "shearbus-hydro: {}\n", error.what());
  }
  return 1;
}

}  // namespace
}  // namespace shearbus::hydro

int main(int argc, char** argv) {
  return shearbus::hydro::shearbus_hydro(argc, argv);
}
