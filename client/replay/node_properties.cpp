#include "client/replay/node_properties.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <variant>

#include "proto/scene/reader.hpp"
#include "proto/scene/with_message.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::replay {

NodeProperties NodeProperties::of(const Table& history) {
  NodeProperties found;
  if (history.has("initial_temperature")) found.initial_temperature_k = history.per_node("initial_temperature");
  if (history.has("pair")) found.pair = history.texts("pair");
  for (const std::string& key : history.names_in("parameter"))
    found.parameters.emplace_back(key, history.per_node("parameter/" + key));
  return found;
}

void NodeProperties::write(files::HistoryWriter& writer) const {
  if (!initial_temperature_k.empty())
    writer.add_static(
        {.name = "initial_temperature", .units = "K", .long_name = "temperature of the layer at the start"},
        initial_temperature_k);
  if (!pair.empty())
    writer.add_texts({.name = "pair", .units = "1", .long_name = "pair of materials of the node, by its name"}, pair);
  for (const auto& [key, values] : parameters)
    writer.add_static({.name = "parameter/" + key,
                       .units = {},
                       .long_name = key + " of the node, in the unit that the key of the scene has"},
                      values);
}

void refuse_changes_of_own(std::span<const std::string> changes, std::span<const std::string> own_keys) {
  for (const std::string& change : changes)
    for (const std::string& key : own_keys)
      if (change.starts_with(key + "="))
        throw Error(
            {.code = Code::kUnsupported,
             .text = fmt::format("{} would change nothing: the nodes have values of their own of that key", change),
             .remedy = "Leave the change out; of a history, or its dataset /parameter/" + key + "."});
}

RegisteredProperties::Nodes& RegisteredProperties::changed() {
  if (nodes_.use_count() > 1) nodes_ = std::make_shared<Nodes>(*nodes_);
  return *nodes_;
}

void RegisteredProperties::add(const Batch& batch, std::span<const std::string> pairs) {
  const auto ids = batch.u64(Field::kNodeId);
  const auto temperature = batch.f64(Field::kInitialTemperature);
  const auto pair = batch.u64(Field::kPair);
  Nodes& nodes = changed();
  for (std::size_t i = 0; i < ids.size(); ++i) {
    Node node;
    if (!temperature.empty()) node.initial_temperature_k = temperature[i];
    if (!pair.empty()) node.pair = pairs[pair[i]];
    for (std::uint32_t key = 0; key < keys_.size(); ++key)
      if (const auto values = batch.f64(Field::kParameter, key); !values.empty()) node.parameters.push_back(values[i]);
    nodes[ids[i]] = std::move(node);
  }
}

void RegisteredProperties::follow(const wire::Request& request, const wire::Reply& reply) {
  if (const auto* open = std::get_if<wire::OpenSession>(&request.body)) {
    keys_ = open->parameters;
    const auto* opened = std::get_if<wire::SessionOpened>(&reply.body);
    several_ = !keys_.empty() || (opened != nullptr && !opened->pairs.empty());
    if (opened != nullptr) scene_ = opened->effective_scene;
    add(request.batch, open->pairs);
  } else if (const auto* added = std::get_if<wire::RegisterNodes>(&request.body)) {
    add(request.batch, added->pairs);
  } else if (std::holds_alternative<wire::AcceptNodes>(request.body)) {
    Nodes& nodes = changed();
    for (const std::uint64_t id : reply.batch.u64(Field::kNodeId)) nodes.try_emplace(id, Node{.known = false});
  } else if (const auto* mark = std::get_if<wire::Mark>(&request.body)) {
    marks_[mark->name] = nodes_;
  } else if (const auto* back = std::get_if<wire::Rollback>(&request.body)) {
    if (const auto to = marks_.find(back->to_mark); to != marks_.end()) nodes_ = to->second;
  }
}

NodeProperties RegisteredProperties::of(std::span<const std::uint64_t> nodes) const {
  const auto refuse = [](std::uint64_t id, const char* what) {
    throw Error({.code = Code::kUnsupported,
                 .text = fmt::format("node {} {}, so that a history cannot have its pair and parameters", id, what),
                 .remedy = "Replay the log itself, or export other nodes with --node ID.",
                 .field = "node_id",
                 .node_ids = {id}});
  };
  NodeProperties found;
  bool heated = false;
  bool named = false;
  bool given = false;
  std::vector<const Node*> rows;
  for (const std::uint64_t id : nodes) {
    const Node& node = nodes_->at(id);
    if (!node.known && several_) refuse(id, "came from another session");
    heated = heated || node.initial_temperature_k > 0.0;
    named = named || !node.pair.empty();
    given = given || !node.parameters.empty();
    rows.push_back(&node);
  }
  for (const std::string& key : given ? keys_ : std::vector<std::string>())
    found.parameters.emplace_back(key, std::vector<double>());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Node& node = *rows[i];
    if (named) found.pair.push_back(node.pair);
    if (given && node.parameters.empty()) refuse(nodes[i], "was registered without parameters, others with");
    for (std::size_t key = 0; key < found.parameters.size(); ++key)
      found.parameters[key].second.push_back(node.parameters[key]);
  }
  if (!heated) return found;
  // Of the others the scene tells it.
  wire::with_message<v1::Scene>([&](v1::Scene& scene) {
    scene::read(scene_, "the recorded scene", scene, [](const auto&, auto&) {});
    for (const Node* node : rows) {
      const v1::Layer* layer = &scene.layer();
      for (const v1::Pair& pair : scene.pair())
        if (pair.name() == node->pair && pair.has_layer()) layer = &pair.layer();
      found.initial_temperature_k.push_back(node->initial_temperature_k > 0.0 ? node->initial_temperature_k
                                                                              : layer->initial_temperature_k());
    }
  });
  return found;
}

std::string RegisteredProperties::past_of(std::span<const std::uint64_t> nodes) const {
  const auto came = std::ranges::find_if(nodes, [&](std::uint64_t id) { return !nodes_->at(id).known; });
  return came == nodes.end() ? std::string() : fmt::format("the layer of node {} began in another session", *came);
}

}  // namespace shearbus::replay
