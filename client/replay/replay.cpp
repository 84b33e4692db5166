#include "client/replay/replay.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>

#include "client/replay/bus.hpp"
#include "client/replay/history_input.hpp"
#include "client/replay/node_properties.hpp"
#include "client/replay/result_file.hpp"
#include "client/replay/tally.hpp"
#include "client/src/input_check.hpp"
#include "proto/files/profile_record.hpp"
#include "proto/files/recording.hpp"
#include "proto/program/interrupt.hpp"
#include "proto/program/program.hpp"
#include "proto/program/progress.hpp"
#include "proto/scene/changed.hpp"
#include "proto/scene/reader.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/explain.hpp"
#include "server/version.hpp"

namespace shearbus::replay {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

const Answer& advance(Bus& bus, const Batch& request, const Table& history, std::size_t step) {
  const double time_s = history.times_s()[step];
  try {
    return bus.advance(request, history.dt_s()[step], time_s, step);
  } catch (const Error& error) {
    Status status = error.status();
    status.text = fmt::format("step {} (ends at {} s): {}", step, time_s, status.text);
    throw Error(status);
  }
}

// Adds the profiles after a step to the record.
void record_profiles(Bus& bus, const Table& history, std::size_t step, const Batch& request,
                     files::ProfileRecord& profiles) {
  std::vector<double> pressure;
  for (const std::uint64_t node : profiles.node_ids()) {
    const auto row = std::ranges::find(history.node_ids(), node) - history.node_ids().begin();
    pressure.push_back(request.f64(Field::kPressure)[static_cast<std::size_t>(row)]);
  }
  profiles.add(history.times_s()[step], bus.profiles(profiles.node_ids(), pressure), pressure);
}

// The columns of a result: the pressure and the velocity jump that were sent, so that a result can be drawn and understood
// without its history, and everything that was answered. The other inputs are in the history alone.
std::vector<ColumnPlace> columns_of(const wire::SessionOpened& opened) {
  std::vector<Field> fields = {Field::kPressure, Field::kVelocityJump};
  fields.insert(fields.end(), opened.reply_columns.begin(), opened.reply_columns.end());
  std::vector<ColumnPlace> columns;
  for (const Field field : fields)
    for (std::uint32_t component = 0; component < (wire::is_tangential(field) ? opened.tangential_components : 1);
         ++component)
      columns.emplace_back(field, component);
  return columns;
}

void write_step(ResultFile& file, const std::vector<ColumnPlace>& columns, const Batch& request, const Answer& answer,
                double time_s, double dt_s) {
  file.begin_step(time_s, dt_s);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const auto [field, component] = columns[i];
    const Batch& batch = answer.columns.has(field, component) ? answer.columns : request;
    if (wire::element_of(field) == wire::Element::kUint8)
      file.set(i, batch.u8(field, component));
    else
      file.set(i, batch.f64(field, component));
  }
  file.end_step();
}

void warn(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) fmt::print(stderr, "shearbus-replay: warning: {}\n", warning);
}

void replay(const Options& options, const Table& history, HistoryInput& input, Bus& bus, ResultFile& result_file,
            files::ProfileRecord& profiles, Tally& tally, RunTime& time) {
  program::Progress progress("replay", options.progress);
  Batch request = bus.request(input.optional_columns(), input.form());
  input.prepare(request);
  InputCheck inputs;
  const std::vector<ColumnPlace> columns = columns_of(bus.opened());
  for (std::size_t step = 0; step < history.steps(); ++step) {
    if (program::interrupted())
      throw std::runtime_error(
          fmt::format("interrupted at step {} of {}; no result is written", step, history.steps()));
    const auto start = Clock::now();
    input.fill(step, request);
    const auto filled = Clock::now();
    const Answer& answer = advance(bus, request, history, step);
    const std::chrono::nanoseconds solver(answer.result.solver_ns);
    time.reading += filled - start;
    time.solver += solver;
    time.bus += std::chrono::nanoseconds(answer.result.round_trip_ns) - solver;

    const auto answered = Clock::now();
    const double dt_s = history.dt_s()[step];
    write_step(result_file, columns, request, answer, history.times_s()[step], dt_s);
    time.writing += Clock::now() - answered;
    warn(inputs.add(request, dt_s, history.node_ids()));
    tally.add(request, answer, history.times_s()[step], dt_s);
    input.feed_back(answer, request);
    if (profiles.due(history.times_s()[step])) record_profiles(bus, history, step, request, profiles);
    progress.at(step + 1, history.steps());
  }
  warn(inputs.end());
}

// Whether a history is replayed a second time in half steps. A history without /dt was not recorded by a host that
// chose its steps. The steps of force-driven histories belong to the host in any case.
bool should_check_steps(const Table& history, const HistoryInput& input) {
  constexpr std::size_t kMostNodeSteps = 50'000;  // a second or so
  return !history.is_recorded() && !input.force_driven() && history.steps() * history.nodes() <= kMostNodeSteps;
}

// Replays the history in half steps, by default with values that change linearly from row to row, and warns if the
// highest temperature of a node differs by more than 0.5 %.
void check_steps(const Options& options, const Table& history, HistoryInput& input, Bus& bus, const Tally& tally) {
  constexpr double kMost = 0.005;
  const bool linear = options.table.rows == Rows::kUnspecified;
  Batch request = bus.request(input.optional_columns(), input.form());
  input.prepare(request);
  std::vector<double> peaks(history.nodes(), 0.0);
  std::vector<double> before;  // values of the row before, column after column
  double time_s = history.start_time_s();
  for (std::size_t step = 0; step < history.steps() && !program::interrupted(); ++step) {
    input.fill(step, request);
    std::vector<double> now;
    for (const wire::Column& column : request.columns())
      for (const double value : std::as_const(request).f64(column.field, column.component)) now.push_back(value);
    if (!linear || before.empty()) before = now;
    const double half_s = 0.5 * history.dt_s()[step];
    for (const double middle : {0.25, 0.75}) {
      std::size_t i = 0;
      for (const wire::Column& column : request.columns())
        for (double& value : request.f64(column.field, column.component)) {
          value = before[i] + middle * (now[i] - before[i]);
          ++i;
        }
      const Batch& answer = bus.advance(request, half_s, time_s += half_s, 0).columns;
      const auto temperature = answer.f64(Field::kInterfaceTemperature);
      for (std::size_t node = 0; node < peaks.size(); ++node) peaks[node] = std::max(peaks[node], temperature[node]);
    }
    before = std::move(now);
  }
  std::size_t worst = 0;
  const auto change = [&](std::size_t node) { return std::abs(peaks[node] / tally.peaks_k()[node] - 1.0); };
  for (std::size_t node = 1; node < peaks.size(); ++node)
    if (change(node) > change(worst)) worst = node;
  if (program::interrupted() || change(worst) <= kMost) return;
  fmt::print(
      stderr,
      "shearbus-replay: warning: the steps are too long for this history: in half steps{}, node {} reaches {:.1f} K "
      "in place of {:.1f} K. {}\n",
      linear ? ", with values linear from row to row" : "", history.node_ids()[worst], peaks[worst],
      tally.peaks_k()[worst],
      linear ? "If the rows are values at instants, say --points and --dt; if they hold over their steps, --steps"
             : "Divide them with --dt");
}

// Refuses, before any work, what could not be written at the end.
void check_out(const Options& options) {
  const std::array<files::InputFile, 2> inputs = {{{"the history", options.history()}, {"the scene", options.scene}}};
  files::refuse_inputs_as_output("--out", options.out, inputs);
  refuse_ending_of_text(options.out);
  if (is_text_result(options.out) && !options.profile_nodes.empty())
    throw Error({.code = Code::kUnsupported,
                 .text = fmt::format("--out {} is CSV, which has no place for --profile-nodes", options.out.string()),
                 .remedy = "Name it .h5."});
}

// Opens a session; faults of the scene name their --set, or their line in the file.
Bus open(const Options& options, const scene::ChangedScene& scene, const Table& history,
         const NodeProperties& properties) try {
  std::vector<std::string> own;
  for (const auto& [key, values] : properties.parameters) own.push_back(key);
  refuse_changes_of_own(scene.changes(), own);
  return {options.server, scene.text(), options.scene.string(), history.node_ids(), properties};
} catch (const Error& fault) {
  throw Error(scene.placed(fault.status()));
}

// What the printed summary says.
struct ReplaySummary {
  const Options& options;
  const std::string& extent;
  const std::string& scene_name;
  const HistoryInput& input;
  const Tally& tally;
  const RunTime& time;
  server::OmittedCost omitted;
  bool replaced;
};

void print_summary(const ReplaySummary& run) {
  fmt::print("{}: {}\n", program::shown(run.options.history()), run.extent);
  fmt::print("  scene                       {} ({})\n", run.scene_name, program::shown(run.options.scene));
  fmt::print("  velocity jump               {}\n", run.input.jump_origin());
  for (const std::string& note : run.input.notes())
    fmt::print("  note                        {}\n", wire::printable(note, wire::kMaxTextBytes));
  fmt::print("{}", run.tally.text(run.time));
  for (const auto& [label, value] : run.omitted.lines()) fmt::print("  {:<28}{}\n", label, value);
  fmt::print("  result                      {}{}\n", program::shown(run.options.out),
             run.replaced ? " (replaced)" : "");
}

}  // namespace

void explain(const fs::path& scene) {
  fmt::print("{}", server::explain(scene::load_text(scene), program::shown(scene)).text());
}

void check_sweep(const Options& options, std::span<const std::string> changes) {
  const std::string text = scene::load_text(options.scene);
  Table history(options.history(), options.table);
  const NodeProperties properties = NodeProperties::of(history);
  for (const std::string& change : changes) {
    std::vector<std::string> set = options.set;
    set.push_back(change);
    open(options, {text, options.scene.string(), set, true}, history, properties).close();
  }
}

void run(const Options& options) {
  const auto start = Clock::now();
  program::stop_at_next_step();
  if (!options.check) check_out(options);
  const scene::ChangedScene changed(scene::load_text(options.scene), options.scene.string(), options.set,
                                    options.swept);
  const std::string& scene = changed.text();
  Table history(options.history(), options.table);
  const NodeProperties properties = NodeProperties::of(history);
  RunTime time{.reading = Clock::now() - start};

  Bus bus = open(options, changed, history, properties);
  HistoryInput input(history, bus.opened(), options.closed_loop);
  files::ProfileRecord profiles(options.profile_nodes, options.profile_times_s);
  if (!options.profile_nodes.empty()) bus.profiles(options.profile_nodes);  // what cannot be read is refused here
  if (profiles.last_s() > history.times_s().back())
    throw Error(
        {.code = Code::kInvalidValue,
         .text = fmt::format("--profile-times has {:.6g} s; expected times up to {:.6g} s, the end of the history",
                             profiles.last_s(), history.times_s().back()),
         .remedy = "Leave out later times."});
  if (options.check) input.check_all_rows();
  bus.want_energy_ledger();
  for (const std::string& warning : bus.opened().warnings)
    program::complain(fmt::format("shearbus-replay: {}", wire::labelled(warning)));
  for (const std::string& kept : changed.kept_by_pairs()) program::complain("shearbus-replay: note: " + kept);
  if (const std::optional<std::string> past = history.meta("past"))
    program::complain(
        fmt::format("shearbus-replay: warning: {}: {}; here it begins at the start, and the answers differ",
                    program::shown(options.history()), wire::printable(*past, wire::kMaxTextBytes)));
  const std::string extent =
      fmt::format("{} of {}, {:.6g} to {:.6g} s", wire::counted(history.steps(), "step"),
                  wire::counted(history.nodes(), "node"), history.start_time_s(), history.times_s().back());
  if (options.check) {
    bus.close();
    fmt::print("{} fits {}: {}\n", program::shown(options.history()), program::shown(options.scene), extent);
    return;
  }

  const server::Entries provenance = server::provenance("shearbus-replay", bus.opened().scene_name, options.arguments);
  std::map<std::string, std::string> meta = {
      {"producer", "shearbus-replay " SHEARBUS_RELEASE},
      {"server_version", bus.server_version()},
      {"scene", bus.opened().effective_scene},
      {"input_file", options.history().filename().string()},
      {"input_hash", files::hash_of_file(options.history())},
      {"input_jump", input.jump_origin()},
      {"commit", server::value_of(provenance, "commit")},
      {"machine", server::value_of(provenance, "machine")},
      {"command", server::value_of(provenance, "command")},
  };
  if (!options.set.empty()) meta.emplace("changes", fmt::format("{}", fmt::join(options.set, ", ")));
  ResultFile result(options.out, options.out, columns_of(bus.opened()), history.node_ids(), properties, meta,
                    history.start_time_s());
  const bool replaced = result.replaces();
  Tally tally(history.node_ids());
  replay(options, history, input, bus, result, profiles, tally, time);
  const wire::SessionClosed totals = bus.close();
  const auto replayed = Clock::now();
  if (files::HistoryWriter* const hdf5 = result.hdf5()) profiles.write(*hdf5);
  result.close();
  time.writing += Clock::now() - replayed;
  time.total = Clock::now() - start;

  if (options.json) {
    nlohmann::ordered_json summary = {{"scene", bus.opened().scene_name},
                                      {"history", options.history().string()},
                                      {"result", options.out.string()},
                                      {"steps", history.steps()},
                                      {"nodes", history.nodes()},
                                      {"start_time_s", history.start_time_s()},
                                      {"end_time_s", history.times_s().back()},
                                      {"velocity_jump", input.jump_origin()}};
    tally.add_to(summary, time);
    nlohmann::ordered_json& origin = summary["provenance"];
    for (const auto& [key, value] : provenance) origin[key] = value;
    fmt::print("{}\n", summary.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
  } else {
    print_summary({.options = options,
                   .extent = extent,
                   .scene_name = bus.opened().scene_name,
                   .input = input,
                   .tally = tally,
                   .time = time,
                   .omitted = server::omitted_cost(bus.opened().effective_scene, totals),
                   .replaced = replaced});
  }
  if (tally.failed_node_steps() > 0)
    fmt::print(stderr, "shearbus-replay: warning: {} node-steps have no answer: the node kept its old state\n",
               tally.failed_node_steps());
  if (!should_check_steps(history, input)) return;
  try {
    Bus halves(options.server, scene, options.scene.string(), history.node_ids(), properties);
    check_steps(options, history, input, halves, tally);
    halves.close();
  } catch (const Error&) {
    // The result is written; only the check of its steps could not be made.
  }
}

}  // namespace shearbus::replay
