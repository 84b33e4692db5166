// shearbus-hydro: reads a scene, makes its problem and interface law, runs the problem and writes the results.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/layer_start.hpp"
#include "hydro_stub/options.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/profiles.hpp"
#include "hydro_stub/restart.hpp"
#include "hydro_stub/run.hpp"
#include "hydro_stub/run2d.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "hydro_stub/verification/problems.hpp"
#include "hydro_stub/wall_zones.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/program.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {
namespace {

constexpr int kInterrupted = 3;

std::filesystem::path output_directory(const Options& options, const guest::HydroScene& scene) {
  if (!options.out.empty()) return options.out;
  std::string plain = scene.scene().name();
  for (char& c : plain) c = wire::is_ascii_alphanumeric(c) || c == '.' || c == '-' ? c : '_';
  return std::filesystem::path("out") / fmt::format("{}-{}", plain, name(scene.hydro().interface_law()));
}

// Returns the scene with the missing constants of its bodies filled in.
guest::HydroScene effective_scene(guest::HydroScene scene) {
  const auto fill = [](const std::string& table, v1::Body& body) {
    scene::set_numbers(physics::constants_of(resolve(body, table)), body);
  };
  if (scene.scene().has_soft()) fill("soft", *scene.mutable_scene()->mutable_soft());
  if (scene.scene().has_hard()) fill("hard", *scene.mutable_scene()->mutable_hard());
  return scene;
}

// Sets what follows from the mesh and the metals together: thickness of plastic layers, depth of friction heat, limits of
// the soft metal.
void couple(const SceneFile& file, Problem2d& problem) {
  const guest::Hydro& hydro = file.scene.hydro();
  if (interface_nodes(problem.bodies) == 0) return;
  problem.layer_thickness = plastic_layers(file, half_wall_zones(problem.bodies));
  problem.strength = interface_strength(file.scene, problem.soft);
  if (hydro.interface_law() == guest::INTERFACE_LAW_COULOMB_TRESCA &&
      hydro.coulomb_tresca().heat_depth() == guest::HEAT_DEPTH_DIFFUSION)
    problem.bodies.contact.heat_depth.emplace(problem.bodies.mesh, problem.bodies.slide_lines, problem.soft.diffusivity,
                                              problem.hard.diffusivity);
}

// Ends a run that was killed after its results were whole: closes its session, if that is open still, and deletes the
// dumps. `resume`: makes the interface law that goes on from the dump.
void end_run(const std::filesystem::path& run, const std::function<std::unique_ptr<InterfaceLaw>()>& resume) {
  try {
    resume()->close();
  } catch (const wire::Error& fault) {
    if (fault.status().code != wire::Code::kUnknownSession) throw;
  }
  RestartDumps(run, {}).remove();
}

void carry_out_2d(const Options& options, const SceneFile& file, const files::DumpReader* from) {
  const guest::HydroScene& scene = file.scene;
  const bool cone = scene.hydro().has_cone_target();
  Problem2d problem = cone ? make_problem2d(make_cone_target(scene)) : make_verification(scene);
  problem.bodies.contact.overlap = options.overlap;
  choose_threads();
  couple(file, problem);
  check_layer_start(scene, interface_nodes(problem.bodies));
  if (options.explain)
    return fmt::print("{}", explain({file.server_text(), file.document.file}, interface_nodes(problem.bodies)));
  RunOptions run{.out = from != nullptr ? options.restart : output_directory(options, scene),
                 .progress = options.progress,
                 .dumps = options.dumps,
                 .provenance = server::provenance("shearbus-hydro", scene.scene().name(), options.arguments),
                 .server = options.server.endpoint};
  if (from != nullptr && run.server.empty()) run.server = from->text("server");
  SubgridServer server{.address = options.server, .state_dir = {}, .check_closure = false};
  server.address.endpoint = run.server;
  std::optional<files::OneWriter> writer;
  if (!options.check) {
    writer.emplace(run.out);
    if (from == nullptr) make_room_for_dumps(run.out);
    // A server in this process keeps its journal next to the dumps, so that its sessions outlive the process.
    const bool subgrid = scene.hydro().interface_law() == guest::INTERFACE_LAW_SUBGRID;
    if (subgrid && run.server.empty() && (from != nullptr || run.dumps.wanted()))
      server.state_dir = server_directory(run.out);
  }
  const bool shocked = scene.hydro().layer_start() == guest::LAYER_START_SHOCKED;
  std::vector<double> temperature(interface_nodes(problem.bodies), scene.scene().layer().initial_temperature_k());
  if (shocked && from != nullptr) {
    from->fill("start_temperature", temperature);  // the layers have started already
  } else if (!options.check) {
    temperature = layer_start(scene, problem, options.progress);
  }
  if (shocked) problem.start_temperature = temperature;
  if (shocked && problem.heat_bound) problem.heat_bound->start_temperature = *std::ranges::min_element(temperature);
  const auto make = [&] {
    return make_law(file, problem.soft, problem.hard, temperature, problem.layer_thickness, server,
                    from != nullptr ? from->text("kept") : "");
  };
  if (from != nullptr && has_ended(run.out)) {
    if (!options.check) end_run(run.out, make);
    return fmt::print("{}: the run had ended, and its results are whole\n", program::shown(run.out));
  }
  const std::unique_ptr<InterfaceLaw> law = make();
  if (options.check) {
    profile_record(scene, interface_nodes(problem.bodies), *law);
    fmt::print("{}: in order; {} zones, {} interface nodes, interface law {}\n", file.document.file,
               problem.bodies.mesh.num_zones(), interface_nodes(problem.bodies), name(scene.hydro().interface_law()));
    return;
  }
  run_problem2d(file, effective_scene(scene), std::move(problem), *law, run, from);
  if (options.plot && cone) plot(run.out, cone);
  fmt::print("  {:<24}{}\n", "results", program::shown(run.out));
}

void carry_out(const Options& options, SceneFile& file) {
  guest::HydroScene& scene = file.scene;
  if (!options.interface_law.empty() && scene.has_hydro())
    scene.mutable_hydro()->set_interface_law(interface_law(options.interface_law));
  for (const std::string& warning : file.warnings()) program::complain(warning);
  if (has_problem2d(scene.hydro())) return carry_out_2d(options, file, nullptr);
  if (options.dumps.wanted())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = "runs of shear_column write no restart dumps, problems in two dimensions do",
                       .remedy = "leave out --dump-every and --dump-interval",
                       .field = "hydro.shear_column"});
  check_layer_start(scene, 0);
  const ColumnProblem problem = make_problem(scene);
  if (options.explain) return fmt::print("{}", explain({file.server_text(), file.document.file}, problem.columns));
  const std::vector<double> layers =
      plastic_layers(file, std::vector<double>(problem.columns, 0.5 * problem.soft.zone_width));
  const std::unique_ptr<InterfaceLaw> law =
      make_law(file, problem.soft_material, problem.hard_material, problem.initial_temperature, layers,
               {.address = options.server, .state_dir = {}});
  if (options.check) {
    profile_record(scene, problem.columns, *law);
    fmt::print("{}: in order; {}, {} of {:.6g} ns, interface law {}\n", file.document.file,
               wire::counted(problem.columns, "column"), wire::counted(problem.steps, "step"), problem.dt * 1e9,
               name(scene.hydro().interface_law()));
    return;
  }
  const std::filesystem::path out = output_directory(options, scene);
  const files::OneWriter writer(out);
  guest::HydroScene effective = effective_scene(scene);
  effective.mutable_hydro()->set_dt_s(problem.dt);
  if (!layers.empty()) effective.mutable_scene()->mutable_layer()->set_thickness_m(layers.front());
  run(effective, problem, *law, out, server::provenance("shearbus-hydro", scene.scene().name(), options.arguments),
      options.progress);
  if (options.plot) plot(out);
  fmt::print("  {:<24}{}\n", "results", program::shown(out));
}

void go_on(const Options& options, SceneFile& file) {
  const files::DumpReader dump = newest_dump(options.restart);
  file = parse_scene(dump.text("scene"), dump.file().string());
  carry_out_2d(options, file, &dump);
}

int shearbus_hydro(int argc, char** argv) {
  SceneFile file;
  try {
    const CommandLine line = parse_command_line(argc, argv);
    if (line.exit_code) return *line.exit_code;
    if (!line.options.restart.empty()) {
      go_on(line.options, file);
    } else {
      file = load_scene(line.options.scene);
      carry_out(line.options, file);
    }
    return program::end_program("shearbus-hydro", 0);
  } catch (const Interrupted& stopped) {
    program::complain("shearbus-hydro", stopped);
    return kInterrupted;
  } catch (const wire::Error& error) {
    program::complain(fmt::format("shearbus-hydro: {}", describe(file.document.placed(error.status()))));
  } catch (const std::exception& error) {
    program::complain("shearbus-hydro", error);
  }
  return 1;
}

// Several threads of OpenMP wait for each other many times a step. They spin for milliseconds, which on processors that
// others use, too, costs many times what the threads gain. libgomp reads how long before main begins, so the program
// starts once more with a wait of some microseconds, unless the user has chosen.
void shorten_waiting(char** arguments) {
  const char* threads = std::getenv("OMP_NUM_THREADS");
  if (threads == nullptr || std::string_view(threads) == "1") return;  // one thread waits for none
  if (std::getenv("OMP_WAIT_POLICY") != nullptr || std::getenv("GOMP_SPINCOUNT") != nullptr) return;
  std::error_code fault;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", fault);
  if (fault || self.filename() != std::filesystem::path(arguments[0]).filename()) return;  // by way of a loader
  if (setenv("GOMP_SPINCOUNT", "3000", 1) != 0) return;
  execv(self.c_str(), arguments);  // if it returns the threads spin for longer
}

}  // namespace
}  // namespace shearbus::hydro

int main(int argc, char** argv) {
  shearbus::hydro::shorten_waiting(argv);
  shearbus::program::begin_program();
  return shearbus::hydro::shearbus_hydro(argc, argv);
}
