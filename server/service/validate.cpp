#include "server/service/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/strategy_columns.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

namespace {

// What a column may hold. The bounds are far outside physics on purpose: they catch wrong units and unset memory, no
// model.
struct Range {
  Field field;
  double lowest;
  double highest;
  const char* unit;
};
constexpr std::array kRanges = {
    Range{Field::kVelocityJump, -1e5, 1e5, "m/s"},    Range{Field::kPressure, -1e12, 1e12, "Pa"},
    Range{Field::kStressMinus, -1e12, 1e12, "Pa"},    Range{Field::kStressPlus, -1e12, 1e12, "Pa"},
    Range{Field::kMassMinus, 1e-9, 1e9, "kg/m2"},     Range{Field::kMassPlus, 1e-9, 1e9, "kg/m2"},
    Range{Field::kSoftShearRate, -1e15, 1e15, "1/s"}, Range{Field::kSoftPlasticStrainRate, 0.0, 1e15, "1/s"},
};
constexpr double kShortestStep = 1e-18;  // [s]
constexpr double kLongestStep = 1.0;     // [s]

[[noreturn]] void refuse(Code code, std::string field, std::string text, std::string remedy,
                         std::vector<std::uint64_t> node_ids = {}) {
  if (node_ids.size() > wire::kMaxNodesNamed) node_ids.resize(wire::kMaxNodesNamed);
  throw wire::Error({.code = code,
                     .text = std::move(text),
                     .remedy = std::move(remedy),
                     .field = std::move(field),
                     .node_ids = std::move(node_ids)});
}

// `node_of(row)` names the node of a row; `valid(value)` must be false for NaN.
template <typename Valid, typename NodeOf>
void check_values(Field field, std::span<const double> column, const std::string& expected, const Valid& valid,
                  const NodeOf& node_of) {
  bool all_valid = true;
  for (const double value : column) all_valid &= valid(value);
  if (all_valid) return;

  std::vector<std::uint64_t> nodes;
  double first = 0.0;
  std::size_t faults = 0;
  for (std::size_t row = 0; row < column.size(); ++row) {
    if (valid(column[row])) continue;
    if (faults++ == 0) first = column[row];
    if (nodes.size() < wire::kMaxNodesNamed) nodes.push_back(node_of(row));
  }
  const std::uint64_t first_node = nodes.front();
  refuse(Code::kInvalidValue, wire::name(field),
         fmt::format("{} of node {} is {}; expected {} ({} of {} rows at fault)", wire::name(field), first_node, first,
                     expected, faults, column.size()),
         "Nothing was changed; correct the values and send the step again.", std::move(nodes));
}

template <std::size_t N>
std::string join_names(const std::array<std::span<const Field>, N>& lists) {
  std::string names;
  for (const auto& list : lists)
    for (const Field field : list) names += std::string(names.empty() ? "" : ", ") + wire::name(field);
  return names;
}

bool contains(std::span<const Field> list, Field field) {
  return std::find(list.begin(), list.end(), field) != list.end();
}

void check_first_components(const wire::Batch& batch) {
  for (const wire::Column& column : batch.columns())
    if (column.component != 0)
      refuse(Code::kUnsupported, wire::name(column.field),
             fmt::format("column {} has component {}; this server knows one tangential component",
                         wire::name(column.field), column.component),
             "Send component 0 only.");
}

void check_columns_of_step(const wire::Batch& batch, const wire::Scene& scene) {
  const wire::StrategyColumns columns = wire::columns_of(scene.strategy);
  check_first_components(batch);
  for (const Field field : columns.required)
    if (!batch.has(field))
      refuse(Code::kShape, wire::name(field), fmt::format("column {} is missing", wire::name(field)),
             "A step of this scene needs " + join_names(std::array{columns.required}) + ".");
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && !contains(columns.required, column.field) &&
        !contains(columns.optional, column.field))
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} does not belong to a step of this scene", wire::name(column.field)),
             "Send " + join_names(std::array{columns.required, columns.optional}) + " and nothing else.");
  if (batch.has(Field::kSoftPlasticStrainRate) && !(scene.interface && scene.interface->plastic_layer))
    refuse(Code::kUnsupported, wire::name(Field::kSoftPlasticStrainRate),
           "a force-driven layer without interface.plastic_layer has no plastic strain to set against the host's",
           "Leave the column out, or set interface.plastic_layer = true.");
  if (batch.has(Field::kSoftShearRate) && scene.velocity_driven.drive != wire::Drive::kInterfaceSlip)
    refuse(Code::kShape, wire::name(Field::kSoftShearRate),
           "soft_shear_rate_per_s drives the layer only with velocity_driven.drive = \"interface_slip\"",
           "Leave the column out, or change the drive.");
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
  for (const wire::Column& column : batch.columns())
    if (column.count != expected)
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} has {} values; expected {} ({})", wire::name(column.field), column.count, expected,
                         rows.all ? "one per node of the session" : "one per node_id"),
             "Give every column one value per row.");
  if (!rows.unknown.empty())
    refuse(Code::kUnknownNode, wire::name(Field::kNodeId),
           fmt::format("node {} is not of this session ({} of {} rows at fault)", rows.unknown.front(),
                       rows.unknown.size(), expected),
           "Open the session with every node it will ever step.", rows.unknown);
  if (!rows.duplicate.empty())
    refuse(Code::kDuplicateNode, wire::name(Field::kNodeId),
           fmt::format("node {} is given more than once in the step", rows.duplicate.front()), "Send one row per node.",
           rows.duplicate);
  return rows;
}

}  // namespace

std::span<const std::uint64_t> check_opening_nodes(const wire::Batch& batch) {
  check_first_components(batch);
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && column.field != Field::kInitialTemperature)
      refuse(Code::kShape, wire::name(column.field),
             fmt::format("column {} does not belong to an opening", wire::name(column.field)),
             "Send node_id and, where it differs from the scene's, initial_temperature_k.");
  const auto ids = batch.u64(Field::kNodeId);
  if (ids.empty())
    refuse(Code::kShape, wire::name(Field::kNodeId), "a session needs at least one node; none was given",
           "Send a node_id column.");
  if (ids.size() > wire::kMaxNodesPerSession)
    refuse(Code::kLimit, wire::name(Field::kNodeId),
           fmt::format("{} nodes; a session holds at most {}", ids.size(), wire::kMaxNodesPerSession),
           "Split the nodes over several sessions.");
  if (const auto repeated = shard::NodeTable::repeated(ids); !repeated.empty())
    refuse(Code::kDuplicateNode, wire::name(Field::kNodeId),
           fmt::format("node {} is given more than once", repeated.front()), "Give every node an id of its own.",
           repeated);
  return ids;
}

std::vector<double> check_initial_temperatures(const wire::Batch& batch, const wire::Scene& effective,
                                               double melting_temperature) {
  const auto solid = [&](double value) { return value > 0.0 && value < melting_temperature; };
  const auto ids = batch.u64(Field::kNodeId);
  if (!batch.has(Field::kInitialTemperature)) {
    const double value = effective.layer.initial_temperature_k;
    if (!solid(value))
      refuse(
          Code::kInvalidScene, "layer.initial_temperature_k",
          fmt::format("layer.initial_temperature_k is {}; expected above 0 and below {} K, where the soft body melts",
                      value, melting_temperature),
          "The layer starts solid.");
    return std::vector<double>(ids.size(), value);
  }
  const auto given = batch.f64(Field::kInitialTemperature);
  if (given.size() != ids.size())
    refuse(Code::kShape, wire::name(Field::kInitialTemperature),
           fmt::format("column initial_temperature_k has {} values; expected {} (one per node_id)", given.size(),
                       ids.size()),
           "Give every column one value per row.");
  check_values(Field::kInitialTemperature, given,
               fmt::format("above 0 and below {} K, where the soft body melts", melting_temperature), solid,
               [&](std::size_t row) { return ids[row]; });
  return {given.begin(), given.end()};
}

shard::Rows check_step(const wire::Downscale& step, const wire::Batch& batch, const wire::Scene& effective,
                       const shard::NodeTable& nodes) {
  if (!(step.dt_s >= kShortestStep && step.dt_s <= kLongestStep))
    refuse(Code::kInvalidValue, "dt_s",
           fmt::format("dt_s is {}; expected from {} to {} s", step.dt_s, kShortestStep, kLongestStep),
           "Nothing was changed; correct it and send the step again.");
  if (effective.layer.modes && step.dt_s < effective.layer.modes->shortest_step_s)
    refuse(
        Code::kInvalidValue, "dt_s",
        fmt::format("dt_s is {}; expected at least layer.modes.shortest_step_s = {} s, down to which this scene's sum "
                    "of exponentials was made",
                    step.dt_s, effective.layer.modes->shortest_step_s),
        "Nothing was changed; open the session with a shorter layer.modes.shortest_step_s.");
  if (!std::isfinite(step.time_s))
    refuse(Code::kInvalidValue, "time_s", fmt::format("time_s is {}; expected a finite time", step.time_s),
           "Nothing was changed; correct it and send the step again.");
  check_columns_of_step(batch, effective);
  shard::Rows rows = locate_rows(batch, nodes);
  const auto row_ids = batch.u64(Field::kNodeId);
  for (const Range& range : kRanges)
    check_values(
        range.field, batch.f64(range.field),
        fmt::format("a number from {:g} to {:g} {}", range.lowest, range.highest, range.unit),
        [&](double value) { return value >= range.lowest && value <= range.highest; },
        [&](std::size_t row) { return rows.all ? nodes.ids()[row] : row_ids[row]; });
  return rows;
}

std::vector<Field> check_wanted(const wire::Downscale& step, wire::Strategy strategy) {
  const auto all = wire::columns_of(strategy).reply;
  if (step.wanted.empty()) return {all.begin(), all.end()};
  for (std::size_t i = 0; i < step.wanted.size(); ++i) {
    const Field field = step.wanted[i];
    if (!contains(all, field))
      refuse(Code::kShape, "wanted",
             fmt::format("field {} ({}) is not a column of this scene's replies", static_cast<std::uint32_t>(field),
                         wire::name(field)),
             "Choose from " + join_names(std::array{all}) + ".");
    if (contains(std::span(step.wanted).first(i), field))
      refuse(Code::kShape, "wanted", fmt::format("{} is wanted twice", wire::name(field)), "Name a column once.");
  }
  return step.wanted;
}

}  // namespace shearbus::service
