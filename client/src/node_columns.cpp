// The columns of requests about nodes.
#include <fmt/ranges.h>

#include <algorithm>

#include "client/src/session.hpp"

namespace shearbus {

wire::Batch named_nodes(std::span<const std::uint64_t> node_ids) {
  return new_nodes(node_ids, {}, {});
}

namespace {

void check_length(std::size_t values, std::size_t nodes, const std::string& what, const std::string& field) {
  if (values != nodes)
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} {} for {} nodes", values, what, nodes),
                 .remedy = "Give one per node, or none.",
                 .field = field});
}

// Refuses parameters that are not those of the session, each once. Returns their order in the session's list.
std::vector<const NodeOptions::Parameter*> in_order(const NodeOptions& options, std::span<const std::string> keys) {
  std::vector<const NodeOptions::Parameter*> ordered;
  for (const std::string& key : keys) {
    const auto found = std::ranges::find(options.parameters, key, &NodeOptions::Parameter::key);
    if (found != options.parameters.end()) ordered.push_back(&*found);
  }
  if (ordered.size() != options.parameters.size() || (!ordered.empty() && ordered.size() != keys.size()))
    throw Error(
        {.code = Code::kShape,
         .text = fmt::format("{} parameters for nodes of a session whose parameters are: {}", options.parameters.size(),
                             keys.empty() ? "none" : fmt::format("{}", fmt::join(keys, ", "))),
         .remedy = "Give values for each of them, or for none; the opening of the session chooses the keys.",
         .field = "parameters"});
  return ordered;
}

}  // namespace

wire::Batch new_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options,
                      std::span<const std::string> keys) {
  const auto parameters = in_order(options, keys);
  std::vector<Field> fields = {Field::kNodeId};
  if (!options.initial_temperature_k.empty()) {
    check_length(options.initial_temperature_k.size(), node_ids.size(), "initial temperatures",
                 "initial_temperature_k");
    fields.push_back(Field::kInitialTemperature);
  }
  if (!options.pair.empty() || !options.pairs.empty()) {
    check_length(options.pair.size(), node_ids.size(), "pairs", "pair");
    fields.push_back(Field::kPair);
  }
  for (const NodeOptions::Parameter* parameter : parameters)
    check_length(parameter->values.size(), node_ids.size(), "values of " + parameter->key, parameter->key);
  if (!parameters.empty()) fields.push_back(Field::kParameter);
  if (node_ids.empty()) return {};
  const auto components = static_cast<std::uint32_t>(std::max<std::size_t>(1, parameters.size()));
  wire::Batch batch = Batch::of(fields, node_ids.size(), components);
  std::ranges::copy(node_ids, batch.u64(Field::kNodeId).begin());
  std::ranges::copy(options.initial_temperature_k, batch.f64(Field::kInitialTemperature).begin());
  std::ranges::copy(options.pair, batch.u64(Field::kPair).begin());
  for (std::uint32_t i = 0; i < parameters.size(); ++i)
    std::ranges::copy(parameters[i]->values, batch.f64(Field::kParameter, i).begin());
  return batch;
}

}  // namespace shearbus
