#include "client/replay/log_export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/replay/log.hpp"
#include "client/replay/node_properties.hpp"
#include "client/replay/result_file.hpp"
#include "client/replay/table.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/program.hpp"
#include "proto/wire/columns.hpp"
#include "server/version.hpp"

namespace shearbus::replay {
namespace {

struct Row {
  std::uint64_t record = 0;  // index in the log
  double dt_s = 0.0;
  double time_s = 0.0;
};

using Place = ColumnPlace;

// What the first reading of a log finds: the rows of the table, its columns and nodes.
struct Plan {
  std::vector<Row> rows;
  std::vector<std::uint64_t> nodes;
  std::vector<Place> inputs, outputs;           // columns that all steps have
  NodeProperties properties;                    // of the nodes
  std::map<Place, std::vector<double>> masses;  // of the first step
  bool masses_change = false;
  std::string scene;
  std::string past;  // why a replay of the table begins otherwise than the log; empty: it does not
  double start_s = 0.0;
  bool host_times = true;  // whether time_s is the end of each step, else the sum of dt
};

// Reads a log again, and calls visit(log, order, row) for each of these rows, in their order.
void each_row(const std::filesystem::path& file, const std::vector<Row>& rows, const auto& visit) {
  Log log(file);
  NodeOrder order;
  for (auto row = rows.begin(); row != rows.end() && log.next();) {
    if (log.index() == row->record) visit(log, order, *row++);
    order.follow(log.request(), log.reply());
  }
}

class Planner {
 public:
  Planner(const ExportOptions& options, Plan& plan) : options_(options), plan_(plan), log_(options.log) {}

  void run() {
    while (log_.next()) {
      if (log_.reply().status.ok()) follow();
      order_.follow(log_.request(), log_.reply());
    }
    plan_.scene = log_.head().scene;
    if (options_.after_mark) {
      const auto mark = marks_.find(*options_.after_mark);
      if (mark == marks_.end())
        throw Error(
            {.code = Code::kUnknownMark, .text = fmt::format("no mark has the name \"{}\"", *options_.after_mark)});
      plan_.rows.erase(plan_.rows.begin(), plan_.rows.begin() + static_cast<std::ptrdiff_t>(
                                                                    std::min(mark->second.size(), plan_.rows.size())));
    }
    if (plan_.rows.empty())
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("{} has no committed step{}", log_.name(),
                                       options_.node ? fmt::format(" of node {}", *options_.node) : "")});
    choose_times();
    check_rows();
    plan_.properties = registered_.of(plan_.nodes);
    plan_.past = options_.after_mark ? "the layers began before the mark" : registered_.past_of(plan_.nodes);
    if (options_.after_mark) plan_.properties.initial_temperature_k.clear();
  }

 private:
  void follow() {
    const wire::Request& request = log_.request();
    if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
      if (step->commit_previous) commit();
      standing_ = Row{.record = log_.index(), .dt_s = step->dt_s, .time_s = step->time_s};
      if (step->mode == wire::Mode::kAdvance) commit();
    } else if (std::holds_alternative<wire::Commit>(request.body)) {
      commit();
    } else if (const auto* mark = std::get_if<wire::Mark>(&request.body)) {
      marks_[mark->name] = plan_.rows;
    } else if (const auto* back = std::get_if<wire::Rollback>(&request.body)) {
      standing_.reset();
      if (const auto to = marks_.find(back->to_mark); to != marks_.end()) plan_.rows = to->second;
    }
    registered_.follow(request, log_.reply());
  }

  void commit() {
    if (standing_) plan_.rows.push_back(*standing_);
    standing_.reset();
  }

  void choose_times() {
    std::vector<Row>& rows = plan_.rows;
    plan_.start_s = rows.front().time_s - rows.front().dt_s;
    for (std::size_t i = 0; i < rows.size() && plan_.host_times; ++i) {
      const double before = i == 0 ? plan_.start_s : rows[i - 1].time_s;
      const double allowed = 5e-7 * (rows[i].dt_s + std::abs(rows[i].time_s));
      plan_.host_times = rows[i].time_s > before && std::abs(rows[i].time_s - before - rows[i].dt_s) <= allowed;
    }
    if (!plan_.host_times) sum_times();
  }

  // Takes the sum of the steps' lengths as the end of each step.
  void sum_times() {
    plan_.start_s = 0.0;
    double time = 0.0;
    for (Row& row : plan_.rows) row.time_s = time += row.dt_s;
  }

  // Reads the log again for what all rows have in common. With a chosen node, only the rows that name it stay.
  void check_rows() {
    std::vector<Row> kept;
    each_row(options_.log, plan_.rows, [&](const Log& log, const NodeOrder& order, const Row& row) {
      if (add(log, order, kept.empty())) kept.push_back(row);
    });
    if (kept.size() != plan_.rows.size()) plan_.host_times = false;
    plan_.rows = std::move(kept);
    if (plan_.rows.empty())
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("{} has no committed step of node {}", log_.name(), options_.node.value_or(0))});
    if (!plan_.host_times) sum_times();
  }

  // Whether a step belongs into the table. Throws Error if its nodes are not those of the table.
  bool add(const Log& log, const NodeOrder& order, bool first) {
    const auto ids = order.rows_of(log.request());
    const auto* step = std::get_if<wire::Downscale>(&log.request().body);
    if (options_.node) {
      const bool named = std::ranges::find(ids, *options_.node) != ids.end();
      if (!named && step->absent_nodes == wire::AbsentNodes::kOpen &&
          std::ranges::find(order.ids(), *options_.node) != order.ids().end())
        throw Error({.code = Code::kUnsupported,
                     .text = fmt::format("node {} was stepped as an open contact in record {}, which has no row of it",
                                         *options_.node, log.index()),
                     .remedy = "Replay the log in place of the table."});
      if (!named) return false;
    }
    std::vector<std::uint64_t> nodes =
        options_.node ? std::vector{*options_.node} : std::vector<std::uint64_t>(ids.begin(), ids.end());
    if (first) plan_.nodes = nodes;
    if (!std::ranges::is_permutation(nodes, plan_.nodes) || (!options_.node && nodes.size() != order.ids().size()))
      throw Error({.code = Code::kUnsupported,
                   .text = fmt::format("the nodes of the steps change: {} in record {}, {} before", nodes.size(),
                                       log.index(), first ? order.ids().size() : plan_.nodes.size()),
                   .remedy = "A table has the same nodes in every row: export one of them with --node ID."});
    keep_common(plan_.inputs, log.request().batch, first);
    keep_common(plan_.outputs, log.reply().batch, first);
    for (const Place& place : plan_.inputs) {
      if (!is_per_node(place.first)) continue;
      std::vector<double> masses(plan_.nodes.size());
      values_of(log.request().batch, place, ids, masses);
      if (first)
        plan_.masses[place] = masses;
      else if (plan_.masses[place] != masses)
        plan_.masses_change = true;
    }
    return true;
  }

  static void keep_common(std::vector<Place>& places, const wire::Batch& batch, bool first) {
    if (first)
      for (const wire::Column& column : batch.columns())
        if (column.element != wire::Element::kUint64) places.emplace_back(column.field, column.component);
    std::erase_if(places, [&](const Place& place) { return !batch.has(place.first, place.second); });
  }

 public:
  // The values of a column in the order of the table's nodes.
  template <typename Value>
  void values_of(const wire::Batch& batch, const Place& place, std::span<const std::uint64_t> ids,
                 std::vector<Value>& values) {
    if (!std::ranges::equal(ids, last_ids_) || places_.empty()) {
      std::map<std::uint64_t, std::size_t> row_of;
      for (std::size_t row = 0; row < ids.size(); ++row) row_of[ids[row]] = row;
      places_.clear();
      for (const std::uint64_t node : plan_.nodes) places_.push_back(row_of.at(node));
      last_ids_.assign(ids.begin(), ids.end());
    }
    const auto copy = [&](const auto& column) {
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = column[places_[i]];
    };
    if constexpr (sizeof(Value) == 1)
      copy(batch.u8(place.first, place.second));
    else
      copy(batch.f64(place.first, place.second));
  }

 private:
  const ExportOptions& options_;
  Plan& plan_;
  Log log_;
  NodeOrder order_;
  RegisteredProperties registered_;
  std::optional<Row> standing_;                    // the trial that waits for commit or rollback
  std::map<std::string, std::vector<Row>> marks_;  // rows that lead to each mark
  std::vector<std::uint64_t> last_ids_;
  std::vector<std::size_t> places_;  // of the table's nodes in the rows of the last step
};

}  // namespace

std::size_t export_log(const ExportOptions& options) {
  const std::array<files::InputFile, 1> read = {{{"the log", options.log}}};
  files::refuse_inputs_as_output("--out", options.out, read);
  refuse_ending_of_text(options.like());
  Plan plan;
  Planner planner(options, plan);
  planner.run();
  std::vector<Place> columns;
  const bool csv = is_text_result(options.like());
  for (const Place& place : plan.inputs)
    if (csv || !is_per_node(place.first) || plan.masses_change) columns.push_back(place);
  const std::size_t inputs = columns.size();
  columns.insert(columns.end(), plan.outputs.begin(), plan.outputs.end());
  std::map<std::string, std::string> meta = {{"producer", "shearbus-replay " SHEARBUS_RELEASE},
                                             {"commit", server::kCommit},
                                             {"scene", plan.scene},
                                             {"input_file", options.log.filename().string()},
                                             {"input_hash", files::hash_of_file(options.log)},
                                             {"times", plan.host_times ? "the host's" : "sums of dt"}};
  if (!options.changes.empty()) meta.emplace("changes", options.changes);
  if (!plan.past.empty()) {
    meta.emplace("past", plan.past);
    if (options.changes.empty())
      program::complain(
          fmt::format("shearbus-replay: warning: {}: {}; a replay of the table lets the layers begin at the start",
                      program::shown(options.like()), plan.past));
  }
  ResultFile table(options.out, options.like(), columns, plan.nodes, plan.properties, meta, plan.start_s);
  if (files::HistoryWriter* const hdf5 = table.hdf5(); hdf5 != nullptr && !plan.masses_change)
    for (const auto& [place, values] : plan.masses)
      hdf5->add_static(files::quantity_of_column(place.first, place.second), values);
  std::vector<double> numbers(plan.nodes.size());
  std::vector<std::uint8_t> codes(plan.nodes.size());
  each_row(options.log, plan.rows, [&](const Log& log, const NodeOrder& order, const Row& row) {
    const auto ids = order.rows_of(log.request());
    table.begin_step(row.time_s, row.dt_s);
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const wire::Batch& batch = i < inputs ? log.request().batch : log.reply().batch;
      if (wire::element_of(columns[i].first) == wire::Element::kUint8) {
        planner.values_of(batch, columns[i], ids, codes);
        table.set(i, std::span<const std::uint8_t>(codes));
      } else {
        planner.values_of(batch, columns[i], ids, numbers);
        table.set(i, std::span<const double>(numbers));
      }
    }
    table.end_step();
  });
  table.close();
  return plan.rows.size();
}

}  // namespace shearbus::replay
