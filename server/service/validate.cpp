#include "server/service/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>

#include "proto/wire/columns.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/service/columns.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

void refuse(Code code, std::string field, std::string text, std::string remedy, std::vector<std::uint64_t> node_ids) {
  if (node_ids.size() > wire::kMaxNodesNamed) node_ids.resize(wire::kMaxNodesNamed);
  throw wire::Error({.code = code,
                     .text = std::move(text),
                     .remedy = std::move(remedy),
                     .field = std::move(field),
                     .node_ids = std::move(node_ids)});
}

namespace {

constexpr double kShortestStep = 1e-18;  // shortest accepted step  [s]
constexpr double kLongestStep = 1.0;     // longest accepted step  [s]

// Returns whether all values are from `lowest` to `highest`; false if one is NaN. The loop is in vectors, and counts
// the two bounds apart: gcc 12 compares the values one by one in a plain loop, and where the two masks are combined.
bool all_between(std::span<const double> values, double lowest, double highest) {
  using Pair = double __attribute__((vector_size(16)));
  using Counts = long long __attribute__((vector_size(16)));
  const Pair low = {lowest, lowest}, high = {highest, highest};
  Counts not_below = {0, 0}, not_above = {0, 0};  // a comparison that holds is -1
  std::size_t at = 0;
  for (; at + 2 <= values.size(); at += 2) {
    Pair pair;
    std::memcpy(&pair, values.data() + at, sizeof pair);
    not_below -= static_cast<Counts>(pair >= low);
    not_above -= static_cast<Counts>(pair <= high);
  }
  const auto checked = static_cast<long long>(at);
  const bool last = at == values.size() || (values[at] >= lowest && values[at] <= highest);
  return not_below[0] + not_below[1] == checked && not_above[0] + not_above[1] == checked && last;
}

std::string join_names(std::initializer_list<std::span<const Field>> lists) {
  std::string names;
  for (const auto& list : lists)
    for (const Field field : list) names += std::string(names.empty() ? "" : ", ") + wire::name(field);
  return names;
}

// Remedy of a refusal: the columns that a step needs, in the far-field form and, if the scene has it, the stick form.
std::string needed_columns(const wire::StrategyColumns& columns) {
  std::string text = "A step of this scene needs " + join_names({columns.required});
  if (columns.stick.empty()) return text + ".";
  return text + " (far-field form), or " + join_names({wire::columns_in(wire::Form::kStick, columns.required)}) +
         " (stick form); all rows of a request have one form.";
}

bool contains(std::span<const Field> list, Field field) {
  return std::find(list.begin(), list.end(), field) != list.end();
}

bool is_pair_column(Field field) {
  return field == Field::kPair || field == Field::kParameter;
}

// Refuses a second component unless the scene has two components and the column is tangential.
void check_components(const wire::Batch& batch, std::uint32_t components) {
  for (const wire::Column& column : batch.columns())
    if (column.component != 0 && column.field != Field::kParameter &&
        (components == 1 || !wire::is_tangential(column.field)))
      refuse(Code::kUnsupported, wire::name(column.field),
             fmt::format("column {} has component {}; {}", wire::name(column.field), column.component,
                         components == 1 ? "this scene's slip has one tangential component" : "it has no direction"),
             components == 1 ? "Send component 0 only, or open a scene with tangential_components = 2."
                             : "Send it with component 0 only.");
}

// Refuses a column that belongs to the strategy of the model but needs an option that this model lacks. The refusal
// names the field `named_in` of the request as the one at fault.
void check_condition(Field field, const shard::Shard& shard, const char* named_in) {
  if (const ColumnCondition* unmet = unmet_condition(field, shard))
    refuse(unmet->code, named_in, fmt::format("{} {}", wire::name(field), unmet->fault), unmet->remedy);
}

// Returns the form of the request, far-field or stick. Refuses a request that has columns of both forms.
wire::Form form_of(const wire::Batch& batch, const wire::StrategyColumns& columns) {
  const auto first_of = [&](std::span<const Field> fields) {
    const auto found = std::ranges::find_if(fields, [&](Field field) { return batch.has(field); });
    return found == fields.end() ? nullptr : &*found;
  };
  const Field* stick = first_of(columns.stick);
  if (stick == nullptr) return wire::Form::kFarField;
  if (const Field* far_field = first_of(wire::kFarFieldColumns); far_field != nullptr)
    refuse(Code::kShape, wire::name(*far_field),
           fmt::format("columns {} and {} are of different forms of a request", wire::name(*stick),
                       wire::name(*far_field)),
           needed_columns(columns));
  return wire::Form::kStick;
}

void check_columns_of_step(const wire::Batch& batch, const shard::Shard& shard) {
  const physics::ModelOptions& options = shard.model().options();
  const wire::StrategyColumns& columns = wire::columns_of(strategy_of(options));
  check_components(batch, static_cast<std::uint32_t>(options.tangential_components));
  const wire::Form form = form_of(batch, columns);
  // The same columns as wire::columns_in() lists.
  const auto of_form = [&](Field field) {
    return form == wire::Form::kFarField || !contains(wire::kFarFieldColumns, field);
  };
  const auto check_given = [&](Field field) {
    if (!batch.has(field))
      refuse(Code::kShape, wire::name(field), fmt::format("column {} is missing", wire::name(field)),
             needed_columns(columns));
    if (options.tangential_components == 2 && wire::is_tangential(field) && !batch.has(field, 1))
      refuse(Code::kShape, wire::name(field), fmt::format("component 1 of column {} is missing", wire::name(field)),
             "The scene has tangential_components = 2: send both components of every tangential column.");
  };
  for (const Field field : columns.required)
    if (of_form(field)) check_given(field);
  for (const Field field : columns.optional)
    if (batch.has(field) || batch.has(field, 1)) check_given(field);
  if (form == wire::Form::kStick) std::ranges::for_each(wire::kStickColumns, check_given);

  for (const wire::Column& column : batch.columns()) {
    const bool required = (contains(columns.required, column.field) && of_form(column.field)) ||
                          (form == wire::Form::kStick && contains(wire::kStickColumns, column.field));
    if (column.field != Field::kNodeId && !required && !contains(columns.optional, column.field))
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} does not belong to a step of this scene", wire::name(column.field)),
             "Send " + join_names({wire::columns_in(form, columns.required), columns_met(columns.optional, shard)}) +
                 " and nothing else.");
    check_condition(column.field, shard, wire::name(column.field));
  }
}

}  // namespace

void check_times(const wire::Downscale& step, const physics::ModelOptions& options) {
  if (!(step.dt_s >= kShortestStep && step.dt_s <= kLongestStep))
    refuse(Code::kInvalidValue, "dt_s",
           fmt::format("dt_s is {}; expected from {} to {} s", step.dt_s, kShortestStep, kLongestStep),
           "Nothing was changed; correct it and send the step again.");
  if (options.modes && !options.tolerance && step.dt_s < options.modes->shortest_step)
    refuse(
        Code::kInvalidValue, "dt_s",
        fmt::format("dt_s is {}; expected at least layer.modes.shortest_step_s = {} s, down to which this scene's sum "
                    "of exponentials was made",
                    step.dt_s, options.modes->shortest_step),
        "Nothing was changed; open the session with a shorter layer.modes.shortest_step_s.");
  if (options.tolerance && step.dt_s < physics::kShortestControlledStep)
    refuse(Code::kInvalidValue, "dt_s",
           fmt::format("dt_s is {}; expected at least {} s in a scene with a tolerance", step.dt_s,
                       physics::kShortestControlledStep),
           "Nothing was changed; open the session with cells and grading in place of the tolerance.");
  if (!std::isfinite(step.time_s))
    refuse(Code::kInvalidValue, "time_s", fmt::format("time_s is {}; expected a finite time", step.time_s),
           "Nothing was changed; correct it and send the step again.");
}

namespace {

void check_counts(const wire::Batch& batch, std::size_t expected, const char* why) {
  for (const wire::Column& column : batch.columns())
    if (column.count != expected)
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} has {} values; expected {} ({})", wire::name(column.field), column.count, expected,
                         why),
             "Give every column one value per row.");
}

shard::Rows locate_rows(const wire::Batch& batch, const shard::NodeTable& nodes) {
  shard::Rows rows;
  std::size_t expected = nodes.size();
  if (batch.has(Field::kNodeId)) {
    expected = batch.u64(Field::kNodeId).size();
    rows = nodes.locate(batch.u64(Field::kNodeId));
  } else {
    rows.all = true;
  }
  check_counts(batch, expected, rows.all ? "one per node of the session" : "one per node_id");
  if (!rows.unknown.empty())
    refuse(Code::kUnknownNode, wire::name(Field::kNodeId),
           fmt::format("node {} is not of this session ({} of {} rows at fault)", rows.unknown.front(),
                       rows.unknown.size(), expected),
           "Name nodes the session was opened with or that were registered since.", rows.unknown);
  if (!rows.duplicate.empty())
    refuse(Code::kDuplicateNode, wire::name(Field::kNodeId),
           fmt::format("node {} is given more than once in the request", rows.duplicate.front()),
           "Send one row per node.", rows.duplicate);
  return rows;
}

// Refuses values of a request that are outside of the bounds of their columns.
void check_inputs(const wire::Batch& batch, const shard::Rows& rows, const shard::NodeTable& nodes) {
  bool faults = false;
  for (const wire::Column& column : batch.columns()) {
    const wire::ColumnRow& row = wire::column_row(column.field);
    const std::span<const double> values = batch.f64(column.field, column.component);
    faults = faults || (row.kind == wire::Kind::kInput && !all_between(values, row.lowest, row.highest));
  }
  if (!faults) return;
  // The first fault in the order of the table is refused, whatever the order of the request's columns.
  for (const wire::ColumnRow& row : wire::column_rows())
    for (std::uint32_t component = 0; row.kind == wire::Kind::kInput && component < 2; ++component)
      check_rows(
          Code::kInvalidValue, wire::name(row.field), batch.f64(row.field, component),
          [&](std::size_t, double value) { return value >= row.lowest && value <= row.highest; },
          [&](std::size_t at) { return node_of(nodes, rows, batch, at); },
          [&](std::uint64_t node, std::size_t, double value) {
            return fmt::format("{} of node {} is {}; expected a number from {:g} to {:g} {}", wire::name(row.field),
                               node, value, row.lowest, row.highest, row.unit);
          },
          "Nothing was changed; correct the values and send the step again.");
}

// The node_id column of an opening or of a change of nodes. The column may be empty only if `needed` is null; else
// `needed` names, for the message, the request that needs nodes.
std::span<const std::uint64_t> check_node_column(const wire::Batch& batch, const char* needed, bool new_nodes) {
  check_components(batch, 1);
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && column.field != Field::kInitialTemperature &&
        !(new_nodes && is_pair_column(column.field)))
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} does not belong to nodes that are named", wire::name(column.field)),
             "Send node_id and, where new nodes differ from the scene's, initial_temperature_k, pair and parameter.");
  const auto ids = batch.u64(Field::kNodeId);
  if (ids.empty() && needed != nullptr)
    refuse(Code::kShape, wire::name(Field::kNodeId), fmt::format("{} needs at least one node; none was given", needed),
           "Name the nodes, each by an id.");
  if (const auto repeated = shard::NodeTable::repeated(ids); !repeated.empty())
    refuse(Code::kDuplicateNode, wire::name(Field::kNodeId),
           fmt::format("node {} is given more than once", repeated.front()), "Give every node an id of its own.",
           repeated);
  check_counts(batch, ids.size(), "one per node_id");
  return ids;
}

// Refuses parameters of nodes with which the soft body is not solid at the scene's start temperature.
void check_scene_temperature(const physics::ModelOptions& options) {
  const double value = options.initial_temperature;
  if (value > 0.0 && value < options.soft.melting_temperature) return;
  refuse(Code::kInvalidScene, "layer.initial_temperature_k",
         fmt::format("layer.initial_temperature_k is {}; expected above 0 and below {} K, where the soft body melts",
                     value, options.soft.melting_temperature),
         "The layer starts solid.");
}

}  // namespace

void check_session_size(std::size_t nodes) {
  if (nodes > wire::kMaxNodesPerSession)
    refuse(Code::kLimit, wire::name(Field::kNodeId),
           fmt::format("{} nodes; a session holds at most {}", nodes, wire::kMaxNodesPerSession),
           "Split the nodes over several sessions.");
}

std::span<const std::uint64_t> check_opening_nodes(const wire::Batch& batch, const std::string& domain) {
  if (!domain.empty()) check_name(domain, "open_session.domain");
  const auto ids = check_node_column(batch, domain.empty() ? "a session without a domain" : nullptr, true);
  check_session_size(ids.size());
  return ids;
}

std::span<const std::uint64_t> check_new_nodes(const wire::Batch& batch, const shard::NodeTable& nodes) {
  const auto ids = check_node_column(batch, "the request", true);
  check_session_size(nodes.size() + ids.size());
  std::vector<std::uint64_t> sorted(ids.begin(), ids.end());
  std::sort(sorted.begin(), sorted.end());
  if (const auto there = nodes.common(sorted); !there.empty())
    refuse(Code::kDuplicateNode, wire::name(Field::kNodeId),
           fmt::format("node {} is of this session already ({} of {} rows at fault)", there.front(), there.size(),
                       ids.size()),
           "Retire a node before its id is used again.", there);
  return ids;
}

shard::Rows check_leaving_nodes(const wire::Batch& batch, const shard::NodeTable& nodes) {
  check_node_column(batch, "the request", false);
  if (batch.has(Field::kInitialTemperature))
    refuse(Code::kShape, wire::name(Field::kInitialTemperature), "nodes that leave have no initial temperature",
           "Send node_id and nothing else.");
  return locate_rows(batch, nodes);
}

void check_name(const std::string& name, const std::string& field) {
  if (name.empty() || name.size() > wire::kMaxNameBytes)
    refuse(Code::kInvalidValue, field,
           fmt::format("{} has {} bytes; expected 1 to {}", field, name.size(), wire::kMaxNameBytes),
           "Choose another name.");
  check_printable(name, field);
}

void check_printable(const std::string& text, const std::string& field) {
  if (wire::has_control_character(text))
    refuse(Code::kInvalidValue, field, fmt::format("{} has a control character; expected printable text", field),
           "Choose another name. A text of fixed length must be cut after its last character.");
}

void refuse_failed_step(const wire::Batch& batch, const shard::NodeTable& nodes,
                        std::span<const std::uint8_t> outcomes) {
  const std::span<const std::uint64_t> row_ids = batch.has(Field::kNodeId) ? batch.u64(Field::kNodeId) : nodes.ids();
  std::vector<std::uint64_t> ids;
  for (std::size_t row = 0; row < outcomes.size(); ++row)
    if ((outcomes[row] & wire::kFailed) != 0) ids.push_back(row_ids[row]);
  if (ids.empty())
    refuse(Code::kStepFailed, "downscale.absent_nodes", "a node that the step does not name has no answer to it",
           "Nothing was changed. Try a shorter step, or POLICY_ACCEPT, with which such nodes keep their states.");
  const std::uint64_t first = ids.front();
  const std::size_t failed = ids.size();
  const auto over_budget =
      std::ranges::count_if(outcomes, [](std::uint8_t outcome) { return (outcome & wire::kOverBudget) != 0; });
  if (over_budget != 0)
    refuse(Code::kStepFailed, "downscale.policy",
           fmt::format("node {} has no answer to this step ({} of {} rows): {} needed more work than the scene's "
                       "work_budget",
                       first, failed, outcomes.size(), over_budget),
           "Nothing was changed. Try a shorter step or a larger tolerance, or open the session with a larger "
           "work_budget.",
           std::move(ids));
  refuse(Code::kStepFailed, "downscale.policy",
         fmt::format("node {} has no answer to this step ({} of {} rows)", first, failed, outcomes.size()),
         "Nothing was changed. Try a shorter step, or POLICY_ACCEPT, with which these nodes keep their states.",
         std::move(ids));
}

std::vector<double> check_initial_temperatures(const wire::Batch& batch, const physics::ModelOptions& options,
                                               const shard::PairsOfNodes* nodes) {
  const auto ids = batch.u64(Field::kNodeId);
  const auto options_of = [&](std::size_t row) -> const physics::ModelOptions& {
    return nodes != nullptr ? nodes->pairs[nodes->of_node[row]].model->options() : options;
  };
  std::vector<double> temperatures(ids.size());
  if (!batch.has(Field::kInitialTemperature)) {
    for (std::size_t pair = 0; nodes != nullptr && pair < nodes->pairs.size(); ++pair)
      check_scene_temperature(nodes->pairs[pair].model->options());
    for (std::size_t row = 0; row < ids.size(); ++row) temperatures[row] = options_of(row).initial_temperature;
    return temperatures;
  }
  const auto given = batch.f64(Field::kInitialTemperature);
  const auto melts_at = [&](std::size_t row) { return options_of(row).soft.melting_temperature; };
  check_rows(
      Code::kInvalidValue, wire::name(Field::kInitialTemperature), given,
      [&](std::size_t row, double value) { return value > 0.0 && value < melts_at(row); },
      [&](std::size_t row) { return ids[row]; },
      [&](std::uint64_t node, std::size_t row, double value) {
        return fmt::format("{} of node {} is {}; expected above 0 and below {} K, where the soft body melts",
                           wire::name(Field::kInitialTemperature), node, value, melts_at(row));
      },
      "Nothing was changed; correct the temperatures, in K.");
  temperatures.assign(given.begin(), given.end());
  return temperatures;
}

std::span<const std::uint64_t> check_pairs(const wire::Batch& batch, std::size_t names) {
  const auto ids = batch.u64(Field::kNodeId);
  const auto places = batch.u64(Field::kPair);
  if (ids.empty() && !batch.has(Field::kPair)) return {};  // of several servers one may have no node of an opening
  if (batch.has(Field::kPair) != (names > 0))
    refuse(Code::kShape, wire::name(Field::kPair),
           names > 0 ? "the request names pairs and has no column pair" : "column pair without a list `pairs` of names",
           "Send both: the names of the pairs, and for each node a place in this list.");
  check_rows(
      Code::kInvalidValue, wire::name(Field::kPair), places,
      [&](std::size_t, std::uint64_t place) { return place < names; }, [&](std::size_t row) { return ids[row]; },
      [&](std::uint64_t node, std::size_t, std::uint64_t place) {
        return fmt::format("pair of node {} is {}; expected a place from 0 to {} in the list `pairs`", node, place,
                           names - 1);
      },
      "Nothing was changed; correct the column.");
  return places;
}

void check_parameters(const wire::Batch& batch, std::span<const std::string> keys) {
  const auto ids = batch.u64(Field::kNodeId);
  for (const wire::Column& column : batch.columns()) {
    if (column.field != Field::kParameter) continue;
    if (column.component >= keys.size())
      refuse(Code::kShape, wire::name(Field::kParameter),
             fmt::format("column parameter has component {}; the session has {} parameters", column.component,
                         keys.size()),
             "Name the keys in open_session.parameters.");
    const std::string& key = keys[column.component];
    check_rows(
        Code::kInvalidValue, key, batch.f64(Field::kParameter, column.component),
        [](std::size_t, double value) { return std::isfinite(value); }, [&](std::size_t row) { return ids[row]; },
        [&](std::uint64_t node, std::size_t, double) {
          return fmt::format("{} of node {} is not a finite number", key, node);
        },
        "Nothing was changed; give each node a value, or leave the column out.");
  }
}

void refuse_pair_columns(const wire::Batch& batch, std::size_t names) {
  for (const Field field : {Field::kPair, Field::kParameter})
    for (const wire::Column& column : batch.columns())
      if (column.field == field)
        refuse(Code::kShape, wire::name(field),
               fmt::format("column {} in a session of one pair without parameters", wire::name(field)),
               "Open the session with a scene of several pairs, or with open_session.parameters.");
  if (names > 0)
    refuse(Code::kInvalidValue, "pairs", "the request names pairs, and the scene has no [pair.NAME]",
           "Leave the list out, or give the scene pairs.");
}

shard::Rows check_step(const wire::Downscale& step, const wire::Batch& batch, const shard::Shard& shard) {
  const shard::NodeTable& nodes = shard.nodes();
  check_times(step, shard.model().options());
  check_columns_of_step(batch, shard);
  shard::Rows rows = locate_rows(batch, nodes);
  if (const std::size_t count = rows.all ? nodes.size() : rows.slots.size(); count > wire::kMaxRowsPerMessage)
    refuse(Code::kLimit, wire::name(Field::kNodeId),
           fmt::format("a step of {} rows; a message has at most {}", count, wire::kMaxRowsPerMessage),
           "Divide the step into parts (downscale.part and parts), which are committed as one.");
  // The nodes that no part names are stepped with the last part.
  rows.others_are_open = !rows.all && step.absent_nodes == wire::AbsentNodes::kOpen && step.part == step.parts;
  check_inputs(batch, rows, nodes);
  return rows;
}

void check_layer_masses(double dt, const wire::Batch& batch, const shard::Rows& rows, const shard::Shard& shard) {
  const physics::ModelOptions& scene = shard.model().options();
  if (!scene.inertia || scene.strategy != physics::Strategy::kForceDriven) return;
  const auto soft = batch.f64(Field::kMassSoft), hard = batch.f64(Field::kMassHard),
             pressure = batch.f64(Field::kPressure);
  std::vector<std::uint64_t> nodes;
  std::string first;
  Field field = Field::kMassSoft;
  for (std::size_t row = 0; row < soft.size(); ++row) {
    if (!(pressure[row] > 0.0)) continue;
    const physics::LeastMasses least = shard.model_of(slot_of(shard.nodes(), rows, row)).least_masses(dt);
    if (soft[row] > least.soft && hard[row] > least.hard) continue;
    nodes.push_back(node_of(shard.nodes(), rows, batch, row));
    if (nodes.size() > 1) continue;
    const bool of_soft = !(soft[row] > least.soft);
    field = of_soft ? Field::kMassSoft : Field::kMassHard;
    first =
        fmt::format("{} of node {} is {:.6g}; expected above {:.6g} kg/m2, {}", wire::name(field), nodes.front(),
                    of_soft ? soft[row] : hard[row], of_soft ? least.soft : least.hard,
                    of_soft ? "the mass of the layer (density times layer.thickness_m), which with layer.inertia is "
                              "taken from that of the half zone, and a little more that a step of dt_s can move"
                            : "of which a step of dt_s can tell how the layer moves it");
  }
  if (nodes.empty()) return;
  const std::size_t faults = nodes.size();
  refuse(Code::kInvalidValue, wire::name(field), fmt::format("{} ({} of {} rows at fault)", first, faults, soft.size()),
         field == Field::kMassSoft
             ? "Nothing was changed; open the session with a layer.thickness_m that is less than half the zone, or "
               "without layer.inertia."
             : "Nothing was changed; send the mass of half the zone, and a step no longer than waves need to cross it.",
         std::move(nodes));
}

shard::Rows check_profile_nodes(const wire::Batch& batch, const shard::NodeTable& nodes) {
  check_components(batch, 1);
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && column.field != Field::kPressure)
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} does not belong to nodes whose profiles are read", wire::name(column.field)),
             "Send node_id and, for the flow stress, pressure_pa.");
  if (batch.u64(Field::kNodeId).empty())
    refuse(Code::kShape, wire::name(Field::kNodeId), "read_profiles needs at least one node; none was given",
           "Name the nodes, each by an id.");
  shard::Rows rows = locate_rows(batch, nodes);
  check_inputs(batch, rows, nodes);
  return rows;
}

std::span<const Field> check_wanted(const wire::Downscale& step, const shard::Shard& shard) {
  const wire::StrategyColumns& columns = wire::columns_of(strategy_of(shard.model().options()));
  const std::span<const Field> all = columns.reply, on_request = columns.on_request;
  if (step.wanted.empty()) return all;
  for (std::size_t i = 0; i < step.wanted.size(); ++i) {
    const Field field = step.wanted[i];
    if (!contains(all, field) && !contains(on_request, field))
      refuse(Code::kShape, "wanted",
             fmt::format("field {} ({}) is not a column of this scene's replies", static_cast<std::uint32_t>(field),
                         wire::name(field)),
             "Choose from " + join_names({all, on_request}) + ".");
    check_condition(field, shard, "wanted");
    if (contains(std::span(step.wanted).first(i), field))
      refuse(Code::kShape, "wanted", fmt::format("{} is wanted twice", wire::name(field)), "Name a column once.");
  }
  return step.wanted;
}

}  // namespace shearbus::service
