#include "server/shard/pairs.hpp"

#include <algorithm>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace shearbus::shard {

bool same_states(const physics::Model& a, const physics::Model& b) {
  return std::ranges::equal(a.layout().states(), b.layout().states(), [](const auto& one, const auto& other) {
    return std::string_view(one.name) == other.name && one.offset == other.offset && one.width == other.width;
  });
}

PairTable::PairTable(physics::Model model) {
  pairs_.push_back({std::make_shared<const physics::Model>(std::move(model)), {}});
}

PairTable::PairTable(std::vector<PairColumn> columns, std::vector<Pair> pairs) : columns_(std::move(columns)) {
  for (std::uint32_t place = 0; place < pairs.size(); ++place) put(place, pairs[place]);
  if (by_values_.size() != (columns_.empty() ? 0 : pairs_.size()))
    throw std::invalid_argument("two pairs have the same values");
}

void PairTable::put(std::uint32_t place, const Pair& pair) {
  if (pair.values.size() != columns_.size())
    throw std::invalid_argument("a pair of " + std::to_string(pair.values.size()) + " values; the shard has " +
                                std::to_string(columns_.size()) + " columns of pairs");
  if (!pairs_.empty() && !same_states(*pair.model, *pairs_.front().model))
    throw std::invalid_argument("the model of a pair has other states than that of the first pair");
  if (place == pairs_.size())
    pairs_.push_back(pair);
  else
    pairs_[place] = pair;
  if (several()) by_values_.emplace(pair.values, place);
}

std::optional<std::uint32_t> PairTable::find(const std::vector<double>& values) const {
  const auto found = by_values_.find(values);
  return found == by_values_.end() ? std::nullopt : std::optional(found->second);
}

std::vector<std::uint32_t> PairTable::add(std::span<const Pair> wanted, std::span<const std::size_t> nodes) {
  std::vector<std::uint32_t> places(wanted.size());
  std::vector<bool> in_use(nodes.size());
  for (std::size_t place = 0; place < nodes.size(); ++place) in_use[place] = nodes[place] > 0 || place == 0;
  std::vector<std::size_t> fresh;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (const auto known = find(wanted[i].values); known || !several()) {
      places[i] = known.value_or(0);
      if (places[i] < in_use.size()) in_use[places[i]] = true;
    } else {
      fresh.push_back(i);
    }
  }
  std::uint32_t place = 0;
  for (const std::size_t i : fresh) {
    while (place < in_use.size() && in_use[place]) ++place;
    if (place < in_use.size()) by_values_.erase(pairs_[place].values);
    put(place, wanted[i]);
    places[i] = place++;
  }
  return places;
}

Operators::Operators(const PairTable& pairs, std::span<const std::size_t> nodes, double dt)
    : dt_(dt), of_pair_(pairs.size()) {
  for (std::size_t pair = 0; pair < pairs.size(); ++pair)
    if (nodes[pair] > 0 || !pairs.several()) of_pair_[pair] = pairs.model(pair).operators(dt);
}

}  // namespace shearbus::shard
