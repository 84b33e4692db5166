#include "server/service/pairs.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "proto/scene/scene.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;
using wire::Field;

namespace {

constexpr std::string_view kPairColumn = "pair";
constexpr std::string_view kParameterColumn = "parameter.";  // and the key

// Tables whose numbers may be parameters, and the numbers of [layer] and [hard_layer] that may.
constexpr std::string_view kTables[] = {"soft.", "hard.", "interface.", "junctions.", "velocity_driven."};
constexpr std::string_view kKeys[] = {"layer.thickness_m", "hard_layer.thickness_m"};

bool may_be_parameter(std::string_view key) {
  const bool allowed = std::ranges::any_of(kTables, [&](std::string_view table) { return key.starts_with(table); }) ||
                       std::ranges::find(kKeys, key) != std::end(kKeys);
  return allowed && scene::find_number(key) != nullptr;
}

// Asks whether the nearest key that may be a parameter was meant; empty: none is near.
std::string help_with(std::string_view parameter) {
  std::vector<std::string> keys;
  for (const google::protobuf::FieldDescriptor* table : scene::keys_of(*v1::Scene::descriptor()))
    if (table->message_type() != nullptr)
      for (const google::protobuf::FieldDescriptor* key : scene::keys_of(*table->message_type()))
        if (std::string path = fmt::format("{}.{}", table->name(), key->name()); may_be_parameter(path))
          keys.push_back(std::move(path));
  const std::string_view near = wire::nearest(parameter, std::vector<std::string_view>(keys.begin(), keys.end()));
  return near.empty() ? "" : fmt::format("; did you mean \"{}\"?", near);
}

std::vector<const shard::StateColumn*> pair_columns(const shard::States& states) {
  std::vector<const shard::StateColumn*> found;
  for (const shard::StateColumn& column : states.columns)
    if (column.name == kPairColumn || column.name.starts_with(kParameterColumn)) found.push_back(&column);
  return found;
}

}  // namespace

struct SessionPairs::Scenes {
  std::vector<std::string> names;               // the first is empty
  std::vector<v1::Scene> scenes;                // effective scene of each named pair
  std::vector<std::vector<double>> parameters;  // values of the parameters in each of them
};

SessionPairs::SessionPairs(const SceneModel& scene, std::vector<std::string> parameters)
    : parameters_(std::move(parameters)), warnings_(scene.warnings) {
  if (scene.pairs.empty() && parameters_.empty()) return;
  for (std::size_t i = 0; i < parameters_.size(); ++i) {
    if (!may_be_parameter(parameters_[i]))
      refuse(Code::kUnsupported, "open_session.parameters",
             fmt::format("{} cannot be a parameter of nodes; expected a number of [soft], [hard], [interface], "
                         "[junctions] or [velocity_driven], or {}{}",
                         wire::printable(parameters_[i], wire::kMaxNameBytes), fmt::join(kKeys, " or "),
                         help_with(parameters_[i])),
             "Name the keys as \"interface.friction_coefficient\". Temperatures of the start are the column "
             "initial_temperature_k; other keys are the same for all nodes of a session.");
    if (std::ranges::count(parameters_, parameters_[i]) > 1)
      refuse(Code::kInvalidValue, "open_session.parameters",
             fmt::format("{} is given twice as a parameter", parameters_[i]), "Name each key once.");
  }
  for (const PairModel& pair : scene.pairs)
    for (std::string_view warning : pair.warnings) {
      const std::string_view note = warning.starts_with(wire::kNote) ? wire::kNote : std::string_view();
      warnings_.push_back(fmt::format("{}[pair.{}]: {}", note, pair.name, warning.substr(note.size())));
    }
  auto made = std::make_shared<Scenes>();
  made->names.emplace_back();
  const v1::Scene outside = scene::without_pairs(*scene.scene);
  made->scenes.push_back(outside);
  for (const v1::Pair& pair : scene.scene->pair()) {
    made->names.push_back(pair.name());
    made->scenes.push_back(scene::scene_of_pair(outside, pair));
  }
  for (std::size_t i = 0; i < made->scenes.size(); ++i) {
    std::vector<double>& values = made->parameters.emplace_back();
    for (const std::string& key : parameters_) {
      const std::optional<double> value = scene::value_of(made->scenes[i], key);
      if (!value)
        refuse(Code::kInvalidScene, key,
               fmt::format("{} is a parameter of nodes, and {} has no such key", key,
                           i == 0 ? "the scene" : "[pair." + made->names[i] + "]"),
               "Give the scene a value of it: that of nodes without one of their own.");
      values.push_back(*value);
    }
  }
  scenes_ = std::move(made);
}

std::vector<std::string> SessionPairs::names() const {
  return several() ? std::vector<std::string>(scenes_->names.begin() + 1, scenes_->names.end())
                   : std::vector<std::string>();
}

std::vector<shard::PairColumn> SessionPairs::columns() const {
  std::vector<shard::PairColumn> columns = {{std::string(kPairColumn), "1"}};
  for (const std::string& key : parameters_)
    columns.push_back({std::string(kParameterColumn) + key, scene::rule_of(*scene::find_number(key)).unit()});
  return columns;
}

std::vector<std::string> SessionPairs::unusual_columns(const wire::Batch& batch) const {
  std::vector<std::string> found;
  const auto ids = batch.u64(Field::kNodeId);
  const auto look = [&](const std::string& name, const std::string& path, std::span<const double> values) {
    const auto& key = *scene::find_number(path);
    const auto unusual = std::ranges::find_if(values, [&](double value) { return !scene::is_usual(key, value); });
    if (unusual == values.end()) return;
    const std::uint64_t node = ids[static_cast<std::size_t>(unusual - values.begin())];
    found.push_back(scene::unusual_text(key, fmt::format("{} of node {}", name, node), *unusual));
  };
  for (std::uint32_t i = 0; i < parameters_.size(); ++i)
    look(parameters_[i], parameters_[i], batch.f64(Field::kParameter, i));
  look(wire::name(Field::kInitialTemperature), "layer.initial_temperature_k", batch.f64(Field::kInitialTemperature));
  return found;
}

shard::PairTable SessionPairs::table(const physics::ModelOptions& first) const {
  if (!several()) return shard::PairTable(physics::Model(first));
  shard::Pair pair{std::make_shared<const physics::Model>(first), {0.0}};
  const std::vector<double>& values = scenes_->parameters.front();
  pair.values.insert(pair.values.end(), values.begin(), values.end());
  return shard::PairTable(columns(), {std::move(pair)});
}

SceneModel SessionPairs::model_of(const std::vector<double>& values) const {
  const auto number = static_cast<std::size_t>(values.front());
  v1::Scene scene = scenes_->scenes[number];
  for (std::size_t i = 0; i < parameters_.size(); ++i)
    if (values[i + 1] != scenes_->parameters[number][i]) scene::set_value(scene, parameters_[i], values[i + 1]);
  return scene_model(scene, false);
}

std::string SessionPairs::scene_of(const shard::Pair& pair) const {
  return model_of(pair.values).effective;
}

// Numbers the distinct lists of `values`, one list for each node, and makes the models of those that `known` lacks. A
// fault names the first node that has the values.
shard::PairsOfNodes SessionPairs::with_models(std::span<const std::vector<double>> values,
                                              const shard::PairTable& known,
                                              std::span<const std::uint64_t> node_ids) const {
  shard::PairsOfNodes made;
  std::map<std::vector<double>, std::uint32_t> places;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto [at, fresh] = places.emplace(values[i], static_cast<std::uint32_t>(made.pairs.size()));
    made.of_node.push_back(at->second);
    if (!fresh) continue;
    if (places.size() > wire::kMaxParameterSets && !node_ids.empty())  // each is a model, made while others wait
      refuse(Code::kLimit, wire::name(Field::kParameter),
             fmt::format("more than {} different sets of parameters in one request", wire::kMaxParameterSets),
             "Register the nodes in several requests.");
    if (const auto place = known.find(values[i])) {
      made.pairs.push_back(known[*place]);
      continue;
    }
    try {
      auto model = std::make_shared<const physics::Model>(model_of(values[i]).options);
      if (!shard::same_states(*model, known.model(0)))
        refuse(Code::kInvalidValue, "parameter",
               "these values give the layer other states than the scene's, as its cells or modes depend on them",
               "Open a session of its own for them, or give the scene these values (shearbus-hydro sends "
               "layer.thickness_m, half a zone), or cells in place of a tolerance.");
      made.pairs.push_back({std::move(model), values[i]});
    } catch (const Error& fault) {
      wire::Status status = fault.status();
      if (status.code == Code::kInvalidScene) status.code = Code::kInvalidValue;
      if (!node_ids.empty()) {
        status.text = fmt::format("parameters of node {}: {}", node_ids[i], status.text);
        status.node_ids = {node_ids[i]};
      }
      throw Error(std::move(status));
    }
  }
  return made;
}

shard::PairsOfNodes SessionPairs::of_new_nodes(const wire::Batch& batch, std::span<const std::string> named,
                                               const shard::PairTable& known) const {
  const auto ids = batch.u64(Field::kNodeId);
  const std::span<const std::uint64_t> places = check_pairs(batch, named.size());
  std::vector<std::size_t> numbers;  // of the names in the request
  for (std::size_t place = 0; place < named.size(); ++place) {
    const auto found = std::ranges::find(scenes_->names, named[place]);
    if (found == scenes_->names.end()) {
      const auto first = std::ranges::find(places, place);
      refuse(Code::kInvalidValue, "pairs",
             fmt::format("the scene has no pair \"{}\"; it has {}", wire::printable(named[place], wire::kMaxNameBytes),
                         fmt::join(names(), ", ")),
             "Name a [pair.NAME] of the scene, or \"\" for the tables outside.",
             first == places.end() ? std::vector<std::uint64_t>()
                                   : std::vector{ids[static_cast<std::size_t>(first - places.begin())]});
    }
    numbers.push_back(static_cast<std::size_t>(found - scenes_->names.begin()));
  }
  check_parameters(batch, parameters_);
  std::vector<std::vector<double>> values(ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const std::size_t number = places.empty() ? 0 : numbers[places[i]];
    values[i].reserve(1 + parameters_.size());
    values[i].push_back(static_cast<double>(number));
    for (std::uint32_t j = 0; j < parameters_.size(); ++j) {
      const auto given = batch.f64(Field::kParameter, j);
      values[i].push_back(given.empty() ? scenes_->parameters[number][j] : given[i] + 0.0);  // no negative zero
    }
  }
  return with_models(values, known, ids);
}

shard::PairsOfNodes SessionPairs::of_states(const shard::States& states, const shard::PairTable& known) const {
  const std::vector<const shard::StateColumn*> columns = pair_columns(states);
  if (columns.size() != known.columns().size())
    throw std::invalid_argument("states of " + std::to_string(columns.size()) + " columns of pairs; the session has " +
                                std::to_string(known.columns().size()));
  std::vector<std::vector<double>> values(states.rows.size());
  for (const shard::StateColumn* column : columns) {
    if (column->width != 1 || column->values.size() != values.size() ||
        !std::ranges::all_of(column->values, [](double value) { return std::isfinite(value); }))
      throw std::invalid_argument("state column " + column->name + " has not one finite value per node");
    for (std::size_t i = 0; i < values.size(); ++i) values[i].push_back(column->values[i]);
  }
  for (const std::vector<double>& of_node : values)
    if (!(of_node.front() >= 0.0 && of_node.front() < static_cast<double>(scenes_->names.size()) &&
          of_node.front() == std::floor(of_node.front())))
      throw std::invalid_argument("state column pair: the scene has no pair " + std::to_string(of_node.front()));
  return with_models(values, known, {});
}

wire::Batch SessionPairs::columns_of_nodes(const shard::Shard& shard) const {
  const std::vector<std::uint64_t>& ids = shard.nodes().ids();
  std::vector<Field> fields = {Field::kNodeId};
  if (several() && ids.size() * sizeof(double) * (2 + parameters_.size()) <= wire::kMaxPayloadBytes) {
    fields.push_back(Field::kPair);
    if (!parameters_.empty()) fields.push_back(Field::kParameter);
  }
  const auto components = static_cast<std::uint32_t>(std::max<std::size_t>(1, parameters_.size()));
  wire::Batch batch = wire::Batch::of(fields, ids.size(), components);
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  if (fields.size() == 1) return batch;
  for (std::size_t row = 0; row < ids.size(); ++row) {
    const std::vector<double>& values = shard.pairs()[shard.pair_of(shard.nodes().slot_of(row))].values;
    batch.u64(Field::kPair)[row] = static_cast<std::uint64_t>(values.front());
    for (std::uint32_t i = 0; i < parameters_.size(); ++i) batch.f64(Field::kParameter, i)[row] = values[i + 1];
  }
  return batch;
}

std::vector<std::string> SessionPairs::parameters_in(const shard::States& states) {
  std::vector<std::string> keys;
  for (const shard::StateColumn& column : states.columns)
    if (column.name.starts_with(kParameterColumn)) keys.push_back(column.name.substr(kParameterColumn.size()));
  return keys;
}

bool SessionPairs::same_columns(const shard::States& states, const shard::PairTable& pairs) {
  return std::ranges::equal(pair_columns(states), pairs.columns(),
                            [](const auto* column, const auto& known) { return column->name == known.name; });
}

bool SessionPairs::same_pairs(const shard::States& a, const shard::States& b) {
  return std::ranges::equal(pair_columns(a), pair_columns(b),
                            [](const auto* one, const auto* other) { return one->values == other->values; });
}

}  // namespace shearbus::service
