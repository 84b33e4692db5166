// The pairs of materials of a shard, each with a model of its own. Their models have the same states, so that the nodes
// of all pairs are stored alike. Most shards have one pair.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::shard {

struct Pair {
  std::shared_ptr<const physics::Model> model;
  // One value for each column of PairTable::columns(): by them files and other shards know the pair.
  std::vector<double> values;
};

// A column of saved states that tells the pair of a node.
struct PairColumn {
  std::string name;
  std::string units;  // in the notation of UDUNITS
};

// Whether tiles of the two models have the same states in the same places.
bool same_states(const physics::Model& a, const physics::Model& b);

// The pairs of some nodes.
struct PairsOfNodes {
  std::vector<Pair> pairs;
  std::vector<std::uint32_t> of_node;  // for each node its place in `pairs`
};

class PairTable {
 public:
  explicit PairTable(physics::Model model);  // one pair and no columns
  // Throws std::invalid_argument if the models have different states, or two pairs the same values.
  PairTable(std::vector<PairColumn> columns, std::vector<Pair> pairs);

  bool several() const { return !columns_.empty(); }
  std::size_t size() const { return pairs_.size(); }
  const physics::Model& model(std::size_t pair) const { return *pairs_[pair].model; }
  const Pair& operator[](std::size_t pair) const { return pairs_[pair]; }
  const std::vector<PairColumn>& columns() const { return columns_; }
  std::optional<std::uint32_t> find(const std::vector<double>& values) const;

  // Adds those of `wanted` that the table does not have, in place of pairs without nodes if there are any except the
  // first, and returns the place of each. `nodes`: number of nodes of each pair of the table.
  std::vector<std::uint32_t> add(std::span<const Pair> wanted, std::span<const std::size_t> nodes);

 private:
  void put(std::uint32_t place, const Pair& pair);

  std::vector<PairColumn> columns_;
  std::vector<Pair> pairs_;
  std::map<std::vector<double>, std::uint32_t> by_values_;  // empty with one pair
};

// The operators of a step length: those of the only pair, or of each pair that has nodes.
class Operators {
 public:
  Operators(const PairTable& pairs, std::span<const std::size_t> nodes, double dt);

  double dt() const { return dt_; }
  const physics::StepOperators& of(std::size_t pair) const { return *of_pair_[pair]; }

 private:
  double dt_;
  std::vector<std::shared_ptr<const physics::StepOperators>>
      of_pair_;  // null for a pair without nodes, where there are several
};

}  // namespace shearbus::shard
