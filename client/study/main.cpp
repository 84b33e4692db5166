// shearbus-study has seven studies: the cost of accuracy, the errors of runs with a tolerance, stability at extreme
// inputs, the map of pressures and velocities in which the velocity-driven model is valid, the fit of a scene's
// parameters to measured curves, the errors of a coupled run's mesh, and the curves of stress against strain of a scene's
// metal. A study runs on fixed problems or on a user's scene.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/study/command.hpp"
#include "client/study/option_rows.hpp"
#include "client/study/precision.hpp"
#include "client/study/stress_strain.hpp"
#include "client/study/tolerance.hpp"
#include "proto/program/command_line.hpp"
#include "proto/program/program.hpp"
#include "proto/program/python.hpp"
#include "server/version.hpp"
#include "shearbus_places.hpp"
#include "tests/campaign/report.hpp"
#include "tests/campaign/user_scene.hpp"

namespace {

using namespace shearbus::study;

constexpr int kExitFault = 1;
constexpr const char* kFooter = R"(Examples:
  shearbus-study precision scene.toml --out out/study
  shearbus-study map scene.toml --out out/map
  shearbus-study fit scene.toml --curve measured.csv --parameter interface.friction_coefficient=0.1:0.6
  shearbus-study mesh hydro_stub/problems/cone_al_steel.toml --out out/mesh

Exit codes: 0 done, 1 a fault, or an invariant that does not hold, 2 a wrong command line.)";

struct Options : CommandOptions {
  double velocity_jump = 100.0;
  double pressure = 11.2e9;
  double end = 1e-6;
  SweepOptions sweep;
  unsigned seeds = 1;
};

std::vector<StudyCase> cases_of(const Options& options) {
  if (options.scene.empty()) return fixed_cases();
  std::vector<StudyCase> cases;
  cases.push_back(case_of(load_scene_with_layer(options.scene).scene.scene(), options.velocity_jump, options.pressure,
                          1.0, options.end));
  return cases;
}

void precision(const Options& options) {
  const std::vector<StudyCase> cases = cases_of(options);
  prepare_study(options, "precision");
  std::vector<Result> results;
  for (const StudyCase& study_case : cases) {
    Result& result = results.emplace_back(sweep(study_case, options.sweep));
    for (Outcome& one : result.outcomes)
      if (one.efficient) one.message_ns = message_ns(study_case, one.setting);
    fmt::print("{}{}", table(result), recommendation(result));
    static_cast<void>(std::fflush(stdout));
  }
  nlohmann::ordered_json study = json(results, options.sweep.repeats);
  if (options.scene.empty()) {
    const std::vector<OptionRow> rows = option_rows(options.sweep.quick);
    fmt::print("{}", table(rows));
    study["options"] = json(rows);
  }
  write_study(options, "precision", study);
}

void tolerance(const Options& options) {
  const std::vector<StudyCase> cases = cases_of(options);
  prepare_study(options, "tolerance");
  const auto tracked = track_tolerances(cases, options.sweep);
  fmt::print("{}", table(tracked));
  static_cast<void>(std::fflush(stdout));
  nlohmann::ordered_json study = json(tracked, options.sweep.repeats);
  if (options.scene.empty() && options.seeds > 0) {
    const auto histories = track_histories(options.seeds, options.sweep.quick);
    fmt::print("{}", table(histories));
    study["histories"] = json(histories);
  }
  write_study(options, "tolerance", study);
}

// Replaces this program by a script of this directory that has its own options.
[[noreturn]] void become(const std::string& script, const std::vector<std::string>& words) {
  const std::string programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  std::vector<std::string> command = {shearbus::program::script("study", script), "--bin", programs};
  command.insert(command.end(), words.begin(), words.end());
  shearbus::program::become_python(std::move(command));
}

}  // namespace

int main(int argc, char** argv) {
  shearbus::program::begin_program();
  Options options;
  CLI::App app("What accuracy costs, what holds at the extremes, where the velocity-driven model is valid.");
  app.require_subcommand(1);
  const auto add = [&](const char* name, const char* what) {
    CLI::App* command =
        add_command(app, name, what, "a scene whose layer's grid and methods are to be chosen", options);
    command->add_option("--velocity-jump", options.velocity_jump, "of SCENE, m/s")->capture_default_str();
    command->add_option("--pressure", options.pressure, "of SCENE, Pa")->capture_default_str();
    command->add_option("--end", options.end, "end of SCENE's run, s")
        ->check(CLI::PositiveNumber)
        ->capture_default_str();
    command->add_option("--repeats", options.sweep.repeats, "timings of each setting; the median counts")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    command->add_flag("--quick", options.sweep.quick, "few settings: to see that it runs");
    return command;
  };
  const CLI::App* of_precision =
      add("precision", "Error against run time: the fixed problems, or SCENE under a fixed jump and pressure");
  add("tolerance", "Error delivered against error requested: the fixed problems and random histories, or SCENE")
      ->add_option("--seeds", options.seeds, "of random histories, eight each; a seed takes minutes, 0: none")
      ->capture_default_str();
  StabilityOptions stability;
  const CLI::App* of_stability = add_stability(app, stability);
  const auto add_script = [&](const std::string& name, const std::string& what) {
    CLI::App* command = app.add_subcommand(name, what + "; " + name + " --help lists its own options");
    command->prefix_command()->set_help_flag();
    return command;
  };
  const CLI::App* of_map = add_script(
      "map", "The velocity-driven model over pressure and velocity: where its layer sticks, slips and melts");
  const CLI::App* of_fit = add_script("fit", "Parameters of a scene from measured curves, or sensitivities");
  CurveOptions curve;
  const CLI::App* of_curve = add_curve(app, curve);
  const CLI::App* of_mesh = add_script("mesh", "What zones, steps and layer cost a cone its accuracy");
  options.arguments = stability.arguments = {argv, static_cast<std::size_t>(argc)};
  shearbus::program::complete(app, "shearbus-study", shearbus::server::version_text, kFooter);
  if (const auto code = shearbus::program::parse(app, argc, argv)) return *code;
  try {
    if (of_stability->parsed()) return shearbus::program::end_program("shearbus-study", run_stability(stability));
    if (of_map->parsed()) become("map/map.py", of_map->remaining());
    if (of_fit->parsed()) become("fit.py", of_fit->remaining());
    if (of_mesh->parsed()) become("mesh.py", of_mesh->remaining());
    if (of_curve->parsed()) {
      run_curve(curve);
    } else {
      of_precision->parsed() ? precision(options) : tolerance(options);
    }
    return shearbus::program::end_program("shearbus-study", 0);
  } catch (const std::exception& error) {
    shearbus::program::complain("shearbus-study", error);
    return kExitFault;
  }
}
