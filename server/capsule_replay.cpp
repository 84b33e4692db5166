#include "server/capsule_replay.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "proto/wire/columns.hpp"
#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"
#include "server/store/checkpoint.hpp"

namespace shearbus::server {
namespace {

store::Capsule read(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
  if (!in.good() && !in.eof()) throw std::runtime_error("cannot read " + file.string());
  return store::read_capsule(std::as_bytes(std::span(bytes)), file.string());
}

CapsuleReplay::Part part_of(const shard::StateColumn& column) {
  CapsuleReplay::Part part{.name = column.name, .units = column.units, .values = column.values.size()};
  bool first = true;
  for (const double value : column.values) {
    if (!std::isfinite(value)) {
      ++part.not_finite;
      continue;
    }
    part.lowest = first ? value : std::min(part.lowest, value);
    part.highest = first ? value : std::max(part.highest, value);
    first = false;
  }
  return part;
}

// Returns the inputs of the failed step as a batch with one row, the node of the capsule. A column that the capsule
// lacks is 0, as it was in the step.
wire::Batch row_of(const store::Capsule& capsule, const physics::ModelOptions& options) {
  const wire::StrategyColumns& columns = wire::columns_of(service::strategy_of(options));
  const bool sticks = std::ranges::find(capsule.inputs, wire::name(wire::Field::kImpedance),
                                        &store::CapsuleValue::name) != capsule.inputs.end();
  const wire::Form form = sticks ? wire::Form::kStick : wire::Form::kFarField;
  std::vector<wire::Field> fields = wire::columns_in(form, columns.required);
  fields.insert(fields.end(), columns.optional.begin(), columns.optional.end());
  wire::Batch row = wire::Batch::of(fields, 1, static_cast<std::uint32_t>(options.tangential_components));
  for (const wire::Column& column : row.columns())
    for (const store::CapsuleValue& input : capsule.inputs)
      if (input.name == service::name_of(column)) row.f64(column.field, column.component)[0] = input.value;
  return row;
}

double value_in(const wire::Batch& answer, const std::string& name) {
  for (const wire::Column& column : answer.columns()) {
    if (name != service::name_of(column)) continue;
    if (column.element == wire::Element::kFloat64) return answer.f64(column.field, column.component)[0];
    return answer.u8(column.field)[0];
  }
  throw std::runtime_error("the capsule's answer has a column " + name + " that this version does not know");
}

}  // namespace

bool CapsuleReplay::same() const {
  return std::ranges::all_of(answer, &Column::same);
}

CapsuleReplay replay_capsule(const std::filesystem::path& file) {
  const store::Capsule capsule = read(file);
  CapsuleReplay replay{.server_version = capsule.server_version,
                       .node_id = capsule.node_id,
                       .sequence = capsule.sequence,
                       .step = capsule.step,
                       .attempt = capsule.attempt,
                       .dt_s = capsule.dt_s,
                       .time_s = capsule.time_s,
                       .scene = capsule.scene};
  for (const shard::StateColumn& column : capsule.state.columns) replay.state.push_back(part_of(column));
  for (const store::CapsuleValue& input : capsule.inputs) replay.inputs.emplace_back(input.name, input.value);

  const service::SceneModel made = service::scene_model(capsule.scene, file.string() + ", scene_toml");
  shard::TaskPool pool(1);
  const std::array node = {capsule.node_id};
  const std::array temperature = {made.options.initial_temperature};
  shard::Shard shard(
      physics::Model(made.options), node, temperature, pool,
      {.check_closure = shard::checks_closure(capsule.state), .sum_energy = shard::sums_energy(capsule.state)});
  shard.restore(capsule.state, nullptr, 0);
  const wire::Batch row = row_of(capsule, made.options);
  const auto reply = wire::columns_of(service::strategy_of(made.options)).reply;
  std::vector<wire::Field> wanted(reply.begin(), reply.end());
  for (const wire::Field field : wire::columns_of(service::strategy_of(made.options)).on_request)
    if (std::ranges::find(capsule.answer, wire::name(field), &store::CapsuleValue::name) != capsule.answer.end())
      wanted.push_back(field);
  wire::Batch answer = wire::Batch::of(wanted, 1, static_cast<std::uint32_t>(made.options.tangential_components));
  shard::Rows rows;
  rows.all = true;
  shard.step(rows, *shard.operators(capsule.dt_s), service::step_columns(row, answer, capsule.dt_s));
  for (const store::CapsuleValue& recorded : capsule.answer) {
    const double found = value_in(std::as_const(answer), recorded.name);
    const bool same = std::bit_cast<std::uint64_t>(found) == std::bit_cast<std::uint64_t>(recorded.value);
    replay.answer.push_back({.name = recorded.name, .recorded = recorded.value, .found = found, .same = same});
  }
  return replay;
}

}  // namespace shearbus::server
