// shearbus-replay: replays histories and event logs, compares, exports and draws them (README.md in this directory).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <optional>

#include "client/replay/capsule.hpp"
#include "client/replay/compare.hpp"
#include "client/replay/log_export.hpp"
#include "client/replay/log_replay.hpp"
#include "client/replay/plot.hpp"
#include "client/replay/python_part.hpp"
#include "client/replay/replay.hpp"
#include "proto/files/event_log.hpp"
#include "proto/program/command_line.hpp"
#include "proto/program/program.hpp"
#include "server/own_laws.hpp"
#include "server/version.hpp"

namespace {

namespace fs = std::filesystem;
namespace replay = shearbus::replay;
namespace files = shearbus::files;
namespace program = shearbus::program;

constexpr int kRunError =
    1;  // exit code of a failed run, or if the answers of a capsule or a log differ when they are repeated
constexpr int kDiffers = 1;  // of compare, as of diff: 0 equal, 1 different, 2 trouble
constexpr int kTrouble = 2;

// Values of the command line.
struct Command {
  replay::Options run;
  fs::path server_key, own_key;
  fs::path capsule;
  bool explain = false;
  bool points = false, steps = false;
  std::string sweep;
  std::vector<std::string> own_laws;
  replay::ExportOptions exported;
  std::uint64_t node = 0;
  fs::path a, b;
  replay::PlotOptions plot;
};

// Declares the options of a replay, which are those of the program without a subcommand.
void describe_replay(CLI::App& app, Command& command) {
  app.add_option("INPUT", command.run.inputs,
                 "a macroscopic history, HDF5 or CSV; or event logs, or a directory of event logs")
      ->type_name("");
  app.add_option("--scene", command.run.scene,
                 "scene to replay it through; of event logs: in place of the recorded one")
      ->type_name("SCENE.toml");
  app.add_option("--set", command.run.set, "change of the scene, repeatable: interface.friction_coefficient=0.2")
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
  app.add_option("--sweep", command.sweep, "one replay for each value of a key, each with a result of its own")
      ->type_name("KEY=A,B,C");
  app.add_option("--capsule", command.capsule,
                 "instead of a history: run the node of this failure capsule again, alone, and compare every column")
      ->type_name("FILE.h5");
  app.add_option("--out", command.run.out,
                 "file for the answers, an older one is replaced once the run has succeeded: HDF5, or CSV if it ends "
                 "in .csv; of "
                 "event logs also a new log")
      ->type_name("RESULT.h5");
  auto* const points = app.add_flag("--points", command.points, "rows are values at instants, linear in between");
  app.add_flag("--steps", command.steps, "rows are steps: their values hold since the time of the row before")
      ->excludes(points);
  program::real_number(
      app.add_option("--dt", command.run.table.dt_s, "largest length of a step, in s: the history is resampled"))
      ->type_name("SECONDS");
  app.add_option("--columns", command.run.table.columns, "names and units of a CSV file's columns; - leaves one out")
      ->type_name("time:us,pressure:GPa,...");
  app.add_option("--from-mark", command.run.from_mark,
                 "of an event log: --set holds from this mark on, and the result begins there")
      ->type_name("NAME");
  app.add_option("--rtol", command.run.rtol,
                 "of event logs: largest relative difference of equal answers; default: same bits");
  app.add_option(
         "--server", command.run.server.endpoint,
         "tcp://host:port or ipc://path of a server, which must answer within 5 s; none: one inside this process")
      ->type_name("ENDPOINT");
  app.add_option("--friction-law", command.own_laws,
                 "without --server: a friction law of a shared library, repeatable; scenes name it as friction_law = "
                 "\"own:NAME\" (shearbus/friction_law.h)")
      ->type_name("NAME=FILE");
  app.add_option("--server-key", command.server_key, "by tcp: file of the server's public key")->type_name("FILE");
  app.add_option("--key", command.own_key, "by tcp: file of one's own secret key, from shearbus-ctl keygen")
      ->type_name("FILE");
  app.add_flag("--check", command.run.check,
               "read every value, compare with the scene, open a session; replay nothing");
  app.add_flag("--explain", command.explain,
               "with --scene alone: which parts of the model it switches on, what each costs on this machine");
  app.add_flag("--closed-loop", command.run.closed_loop,
               "force-driven: each reply's new jump is the next input, although the history records /velocity_jump");
  auto* const nodes =
      program::whole_number(app.add_option("--profile-nodes", command.run.profile_nodes,
                                           "of a history: record the profiles of these nodes, in the group /profiles"))
          ->delimiter(',')
          ->type_name("ID,...");
  program::real_number(
      app.add_option("--profile-times", command.run.profile_times_s,
                     "times of the profiles, in s: each is of the end of the first step at or after it"))
      ->delimiter(',')
      ->needs(nodes)
      ->type_name("SECONDS,...");
  app.add_flag("--json", command.run.json, "print the summary of a history's replay as JSON");
  app.add_flag_callback(
      "--no-progress", [&command] { command.run.progress = false; }, "no progress line on the terminal");
}

constexpr const char* kFooter = R"(Examples:
  shearbus-replay history.h5 --scene scene.toml --out result.h5
  shearbus-replay session.sblog --set interface.friction_coefficient=0.2
  shearbus-replay compare a.h5 b.h5 --rtol 1e-9

Exit codes: 0 done, 1 a fault, or answers that differ when they are repeated, 2 a wrong command line
What a history holds and how to make one: client/replay/README.md)";

void describe(CLI::App& app, Command& command) {
  describe_replay(app, command);
  app.require_subcommand(0, 1);
  CLI::App* const compare =
      app.add_subcommand("compare", "the first step, node and quantity in which two logs or results differ");
  compare->add_option("A", command.a)->required()->type_name("");
  compare->add_option("B", command.b)->required()->type_name("");
  compare->add_option("--rtol", command.run.rtol,
                      "largest relative difference of equal numbers, of tables with the largest difference of each "
                      "column; default: same bits, up to the first that differs");
  compare->footer("Exit code: 0 equal, 1 different, 2 trouble.");
  CLI::App* const exported = app.add_subcommand("export", "the committed steps of an event log as a table");
  exported->add_option("LOG", command.exported.log)->required()->type_name("");
  exported->add_option("--out", command.exported.out, "HDF5, or CSV if it ends in .csv")
      ->required()
      ->type_name("HISTORY");
  program::whole_number(exported->add_option("--node", command.node, "the steps of this node alone"))->type_name("ID");
  CLI::App* const plot = app.add_subcommand("plot", "a picture of a history, a result or an event log");
  plot->add_option("FILES", command.plot.files,
                   "results, which are drawn over each other, and a history that completes them; or a log")
      ->required()
      ->expected(1, 8)
      ->type_name("");
  plot->add_option("--out", command.plot.out, "the picture")->required()->type_name("PICTURE.png");
  program::whole_number(plot->add_option("--node", command.node, "the node to draw; default: the hottest"))
      ->type_name("ID");
  program::complete(app, "shearbus-replay", shearbus::server::version_text, kFooter);
}

// The values of "--sweep key=a,b,c" as changes of the scene, each with a word for the names of files.
std::vector<std::pair<std::string, std::string>> changes_of(const std::string& sweep) {
  const auto equals = sweep.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == sweep.size())
    throw CLI::ValidationError("--sweep", "expected KEY=A,B,C, found " + sweep);
  std::vector<std::pair<std::string, std::string>> changes;
  for (const std::string& value : CLI::detail::split(sweep.substr(equals + 1), ',')) {
    if (value.empty()) throw CLI::ValidationError("--sweep", "a value is empty in " + sweep);
    if (std::ranges::any_of(changes, [&](const auto& earlier) { return earlier.second == value; }))
      throw CLI::ValidationError("--sweep", value + " is given twice in " + sweep);
    changes.emplace_back(sweep.substr(0, equals + 1) + value, value);
  }
  return changes;
}

void check(const CLI::App& app, Command& command) {
  if (const std::string fault = files::fault_of_keys(command.run.server, command.server_key, command.own_key);
      !fault.empty())
    throw CLI::ValidationError(fault);
  if (command.run.rtol < 0) throw CLI::ValidationError("--rtol", "expected a number from 0 on");
  const replay::Options& run = command.run;
  const bool has_history = !run.inputs.empty() || !run.scene.empty() || !run.out.empty();
  if (std::ranges::count_if(command.plot.files, files::is_event_log) > 1)
    throw CLI::ValidationError("FILES", "expected one event log; of several make tables first: shearbus-replay export");
  if (app.got_subcommand("plot") && command.plot.out.extension() != ".png")
    throw CLI::ValidationError("--out",
                               "expected a picture's name that ends in .png, found " + command.plot.out.string());
  if (!app.get_subcommands().empty()) {
    if (has_history) throw CLI::ExcludesError(app.get_subcommands().front()->get_name(), "options of a replay");
    return;
  }
  if (!command.capsule.empty() && has_history) throw CLI::ExcludesError("--capsule", "INPUT, --scene and --out");
  for (const char* name :
       {"--capsule", "--explain", "--friction-law"})  // of this process; a server has laws of its own
    if (app.count(name) > 0 && app.count("--server") > 0) throw CLI::ExcludesError(name, "--server");
  if (command.explain && run.scene.empty()) throw CLI::RequiredError("--scene");
  if (command.explain && !(run.inputs.empty() && run.out.empty() && command.capsule.empty()))
    throw CLI::ExcludesError("--explain", "INPUT, --out and --capsule");
  if (command.explain || !command.capsule.empty()) return;
  if (run.inputs.empty()) throw CLI::RequiredError("INPUT");
  if (app.count("--dt") > 0 && !(run.table.dt_s > 0)) throw CLI::ValidationError("--dt", "expected a length above 0 s");
  if (run.profile_nodes.empty() != run.profile_times_s.empty()) throw CLI::RequiredError("--profile-times");
  if (!command.sweep.empty() && run.out.empty()) throw CLI::RequiredError("--out");
  if (replay::holds_event_logs(run.inputs.front())) {
    for (const char* name :
         {"--points", "--steps", "--dt", "--columns", "--check", "--closed-loop", "--profile-nodes", "--json"})
      if (app.count(name) > 0) throw CLI::ExcludesError(name, "event logs");
    return;
  }
  std::error_code absent;
  if (!std::filesystem::exists(run.inputs.front(), absent) && run.scene.empty())
    throw CLI::ValidationError("INPUT", fmt::format("{}: {}", shearbus::program::shown(run.inputs.front()),
                                                    absent ? absent.message() : "there is no such file or directory"));
  for (const char* name : {"--from-mark", "--rtol"})
    if (app.count(name) > 0) throw CLI::ValidationError(name, "is for event logs; INPUT is none");
  if (run.inputs.size() > 1) throw CLI::ValidationError("INPUT", "expected one history");
  if (run.scene.empty())
    throw CLI::ValidationError("--scene", fmt::format("a history needs it, and {} is no event log",
                                                      shearbus::program::shown(run.inputs.front())));
  if (run.out.empty() && !run.check) throw CLI::RequiredError("--out");
}

// Replays the inputs once. Returns the exit code.
int replay_once(const replay::Options& run) {
  if (replay::holds_event_logs(run.inputs.front())) return replay::replay_logs(run) ? 0 : kRunError;
  replay::run(run);
  return 0;
}

// Replays the inputs once for each value of --sweep, if the scene may have all of them. Returns the exit code.
int replay_sweep(const Command& command) {
  const auto changes = changes_of(command.sweep);
  std::vector<std::string> values;
  values.reserve(changes.size());
  for (const auto& [change, word] : changes) values.push_back(change);
  if (replay::holds_event_logs(command.run.inputs.front()))
    replay::check_sweep_of_logs(command.run, values);
  else
    replay::check_sweep(command.run, values);
  for (const auto& [change, word] : changes) {
    replay::Options one = command.run;
    one.set.push_back(change);
    one.swept = true;
    one.out.replace_filename(command.run.out.stem().string() + "-" + word + command.run.out.extension().string());
    fmt::print("{}\n", change);
    if (const int code = replay_once(one); code != 0) return code;
  }
  return 0;
}

int run(const CLI::App& app, Command& command) {
  shearbus::server::load_own_laws(command.own_laws);
  if (app.got_subcommand("compare")) return replay::compare(command.a, command.b, command.run.rtol) ? 0 : kDiffers;
  if (app.got_subcommand("export")) {
    if (app.get_subcommand("export")->count("--node") > 0) command.exported.node = command.node;
    const std::size_t steps = replay::export_log(command.exported);
    fmt::print("{}: {} steps\n", shearbus::program::shown(command.exported.out), steps);
    return 0;
  }
  if (app.got_subcommand("plot")) {
    if (app.get_subcommand("plot")->count("--node") > 0) command.plot.node = command.node;
    replay::plot(command.plot);
    return 0;
  }
  if (command.explain) {
    replay::explain(command.run.scene);
    return 0;
  }
  if (!command.capsule.empty()) return replay::run_capsule(command.capsule) ? 0 : kRunError;
  shearbus::files::read_keys_into(command.run.server, command.server_key, command.own_key);
  command.run.table.rows = command.points  ? replay::Rows::kPoints
                           : command.steps ? replay::Rows::kSteps
                                           : replay::Rows::kUnspecified;
  return command.sweep.empty() ? replay_once(command.run) : replay_sweep(command);
}

}  // namespace

int main(int argc, char** argv) {
  shearbus::program::begin_program();
  Command command;
  command.run.arguments = {argv, static_cast<std::size_t>(argc)};
  CLI::App app("Replays macroscopic histories and event logs through the subgrid friction service.", "shearbus-replay");
  describe(app, command);
  const auto code = program::parse(app, argc, argv, [&] {
    check(app, command);
    if (!command.sweep.empty()) changes_of(command.sweep);
  });
  if (code) return *code;
  try {
    return shearbus::program::end_program("shearbus-replay", run(app, command));
  } catch (const replay::Told&) {
    return kRunError;
  } catch (const std::exception& error) {
    shearbus::program::complain("shearbus-replay", error);
    return app.got_subcommand("compare") ? kTrouble : kRunError;
  }
}
