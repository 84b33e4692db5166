// shearbus-hydro: scene -> problem and interface law -> run -> results.
#include <fmt/format.h>

#include <cctype>
#include <exception>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/options.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/restart.hpp"
#include "hydro_stub/run.hpp"
#include "hydro_stub/run2d.hpp"
#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::hydro {
namespace {

constexpr int kInterrupted = 3;

std::filesystem::path output_directory(const Options& options, const wire::Scene& scene) {
  if (!options.out.empty()) return options.out;
  std::string plain = scene.name;
  for (char& c : plain) c = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '-' ? c : '_';
  return std::filesystem::path("out") / fmt::format("{}-{}", plain, name(scene.hydro->interface_law));
}

wire::Scene effective_scene(wire::Scene scene, const physics::Material& soft, const physics::Material& hard) {
  scene.soft.given = physics::constants_of(soft);
  scene.hard.given = physics::constants_of(hard);
  return scene;
}

void carry_out_cone_target(const Options& options, const wire::SceneFile& file, const wire::DumpReader* from) {
  const wire::Scene& scene = file.scene;
  const ConeTarget cone = make_cone_target(scene);
  Problem2d problem = make_problem2d(cone);
  const std::vector<double> temperature(interface_nodes(problem.bodies), scene.layer.initial_temperature_k);
  RunOptions run{.out = from != nullptr ? options.restart : output_directory(options, scene),
                 .progress = options.progress,
                 .dumps = options.dumps,
                 .server = options.server};
  if (from != nullptr && run.server.empty()) run.server = from->text("server");
  SubgridServer server{.endpoint = run.server, .state_dir = {}};
  if (!options.check) {
    if (from == nullptr) make_room_for_dumps(run.out);
    // A server in this process outlives it by its journal, beside the dumps.
    if (run.server.empty() && (from != nullptr || run.dumps.wanted())) server.state_dir = server_directory(run.out);
  }
  const std::unique_ptr<InterfaceLaw> law =
      make_law(scene, cone.soft, cone.hard, temperature, server, from != nullptr ? from->text("kept") : "");
  if (options.check) {
    fmt::print("{}: in order; {} zones, {} interface nodes, interface law {}\n", file.file,
               problem.bodies.mesh.num_zones(), temperature.size(), name(scene.hydro->interface_law));
    return;
  }
  run_problem2d(scene, effective_scene(scene, cone.soft, cone.hard), std::move(problem), *law, run, from);
  if (options.plot) plot_cone(run.out);
  fmt::print("  {:<24}{}\n", "results", run.out.string());
}

void carry_out(const Options& options, wire::SceneFile& file) {
  wire::Scene& scene = file.scene;
  if (options.interface_law && scene.hydro) scene.hydro->interface_law = *options.interface_law;
  if (scene.hydro && scene.hydro->cone_target) return carry_out_cone_target(options, file, nullptr);
  if (options.dumps.wanted())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = "runs of shear_column write no restart dumps, problems in two dimensions do",
                       .remedy = "leave out --dump-every and --dump-interval",
                       .field = "hydro.shear_column"});
  const Problem problem = make_problem(scene);
  const std::unique_ptr<InterfaceLaw> law =
      make_law(scene, problem.soft_material, problem.hard_material, problem.initial_temperature,
               {.endpoint = options.server, .state_dir = {}});
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

void go_on(const Options& options, wire::SceneFile& file) {
  const wire::DumpReader dump = newest_dump(options.restart);
  file = wire::parse_scene(dump.text("scene"), dump.file().string());
  carry_out_cone_target(options, file, &dump);
}

int shearbus_hydro(int argc, char** argv) {
  const CommandLine line = parse_command_line(argc, argv);
  if (line.exit_code) return *line.exit_code;
  wire::SceneFile file;
  try {
    if (!line.options.restart.empty()) {
      go_on(line.options, file);
    } else {
      file = wire::load_scene_file(line.options.scene);
      carry_out(line.options, file);
    }
    return 0;
  } catch (const Interrupted& stopped) {
    fmt::print(stderr, "shearbus-hydro: {}\n", stopped.what());
    return kInterrupted;
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
