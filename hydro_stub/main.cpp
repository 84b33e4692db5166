// shearbus-hydro: scene -> problem and interface law -> run -> results.
#include <fmt/format.h>

#include <cctype>
#include <exception>
#include <memory>
#include <utility>
#include <vector>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/options.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/restart.hpp"
#include "hydro_stub/run.hpp"
#include "hydro_stub/run2d.hpp"
#include "hydro_stub/simple_laws.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "hydro_stub/verification/problems.hpp"
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

bool has_problem2d(const wire::Hydro& hydro) {
  return hydro.cone_target || hydro.piston || hydro.flyer_impact || hydro.implosion || hydro.gas_flow ||
         hydro.taylor_bar || hydro.sliding_plates;
}

// The scene with the constants it is run with, of the bodies it has.
wire::Scene effective_scene(wire::Scene scene) {
  for (const auto& [body, table] : {std::pair{&scene.soft, "soft"}, std::pair{&scene.hard, "hard"}}) {
    if (body->given_at_all()) body->given = physics::constants_of(resolve(*body, table));
  }
  return scene;
}

// Without nodes that rub there is nobody to ask a law.
std::unique_ptr<InterfaceLaw> make_law_2d(const wire::Scene& scene, const Problem2d& problem,
                                          const SubgridServer& server, const std::string& kept) {
  const std::vector<double> temperature(interface_nodes(problem.bodies), scene.layer.initial_temperature_k);
  if (temperature.empty()) return std::make_unique<FreeSlipLaw>();
  return make_law(scene, problem.soft, problem.hard, temperature, server, kept);
}

void carry_out_2d(const Options& options, const wire::SceneFile& file, const wire::DumpReader* from) {
  const wire::Scene& scene = file.scene;
  if (wire::Status fault = wire::check_scene(scene); !fault.ok()) throw wire::Error(std::move(fault));
  const bool cone = scene.hydro->cone_target.has_value();
  Problem2d problem = cone ? make_problem2d(make_cone_target(scene)) : make_verification(scene);
  problem.bodies.contact.overlap = options.overlap;
  if (options.explain) return fmt::print("{}", explain(scene, interface_nodes(problem.bodies)));
  RunOptions run{.out = from != nullptr ? options.restart : output_directory(options, scene),
                 .progress = options.progress,
                 .dumps = options.dumps,
                 .server = options.server.endpoint};
  if (from != nullptr && run.server.empty()) run.server = from->text("server");
  SubgridServer server{.address = options.server, .state_dir = {}};
  server.address.endpoint = run.server;
  if (!options.check) {
    if (from == nullptr) make_room_for_dumps(run.out);
    // A server in this process outlives it by its journal, beside the dumps.
    const bool subgrid = scene.hydro->interface_law == wire::InterfaceLaw::kSubgrid;
    if (subgrid && run.server.empty() && (from != nullptr || run.dumps.wanted()))
      server.state_dir = server_directory(run.out);
  }
  const std::unique_ptr<InterfaceLaw> law =
      make_law_2d(scene, problem, server, from != nullptr ? from->text("kept") : "");
  if (options.check) {
    fmt::print("{}: in order; {} zones, {} interface nodes, interface law {}\n", file.file,
               problem.bodies.mesh.num_zones(), interface_nodes(problem.bodies), name(scene.hydro->interface_law));
    return;
  }
  run_problem2d(scene, effective_scene(scene), std::move(problem), *law, run, from);
  if (options.plot && cone) plot_cone(run.out);
  fmt::print("  {:<24}{}\n", "results", run.out.string());
}

void carry_out(const Options& options, wire::SceneFile& file) {
  wire::Scene& scene = file.scene;
  if (options.interface_law && scene.hydro) scene.hydro->interface_law = *options.interface_law;
  if (scene.hydro && has_problem2d(*scene.hydro)) return carry_out_2d(options, file, nullptr);
  if (options.dumps.wanted())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = "runs of shear_column write no restart dumps, problems in two dimensions do",
                       .remedy = "leave out --dump-every and --dump-interval",
                       .field = "hydro.shear_column"});
  const Problem problem = make_problem(scene);
  if (options.explain) return fmt::print("{}", explain(scene, problem.columns));
  const std::unique_ptr<InterfaceLaw> law =
      make_law(scene, problem.soft_material, problem.hard_material, problem.initial_temperature,
               {.address = options.server, .state_dir = {}});
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
  carry_out_2d(options, file, &dump);
}

int shearbus_hydro(int argc, char** argv) {
  wire::SceneFile file;
  try {
    const CommandLine line = parse_command_line(argc, argv);
    if (line.exit_code) return *line.exit_code;
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
