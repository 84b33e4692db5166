// The pairs of materials of a session: those that its scene names, and sets of parameters that its nodes bring. A pair is
// known by its values: the number of the named pair (0: the tables outside of [pair.NAME]), then one for each parameter.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

class SessionPairs {
 public:
  // A session of one pair.
  SessionPairs() = default;
  // `scene`: a scene; `parameters`: keys of the scene that have a value for each node. Throws
  // Error for a key that cannot be a parameter.
  SessionPairs(const SceneModel& scene, std::vector<std::string> parameters);

  bool several() const { return scenes_ != nullptr; }
  std::vector<std::string> names() const;  // of the pairs of the scene, without the tables outside
  const std::vector<std::string>& parameters() const { return parameters_; }
  // of the values of the scene, and of the models of the named pairs
  const std::vector<std::string>& warnings() const { return warnings_; }

  // A warning for each column of these new nodes (a parameter, the initial temperature) that was probably meant in another
  // unit, with the first such node.
  std::vector<std::string> unusual_columns(const wire::Batch& batch) const;

  // A table of the first pair alone.
  shard::PairTable table(const physics::ModelOptions& first) const;

  // The pairs of new nodes, whose ids and columns are in `batch`; `named` is the request's list of names. Models are made
  // for pairs that `known` does not have. Throws Error for columns, names or values at fault.
  shard::PairsOfNodes of_new_nodes(const wire::Batch& batch, std::span<const std::string> named,
                                   const shard::PairTable& known) const;
  // The pairs of nodes whose states come from a file, a mark or another session. Throws std::invalid_argument for states
  // of another kind of session.
  shard::PairsOfNodes of_states(const shard::States& states, const shard::PairTable& known) const;

  // The columns of `session_resumed`: node_id, and of nodes of several pairs, as far as a message has room, pair (0: the
  // tables outside, else the place in names() from 1 on) and parameter.
  wire::Batch columns_of_nodes(const shard::Shard& shard) const;

  // The effective text of a scene that has one of the pairs alone.
  std::string scene_of(const shard::Pair& pair) const;

  // The parameters of the session that saved these states.
  static std::vector<std::string> parameters_in(const shard::States& states);
  // Whether these states are of nodes of a session with the same columns of pairs.
  static bool same_columns(const shard::States& states, const shard::PairTable& pairs);
  // Whether two lists of states give their nodes the same pairs.
  static bool same_pairs(const shard::States& a, const shard::States& b);

 private:
  struct Scenes;
  std::vector<shard::PairColumn> columns() const;
  shard::PairsOfNodes with_models(std::span<const std::vector<double>> values, const shard::PairTable& known,
                                  std::span<const std::uint64_t> node_ids) const;
  SceneModel model_of(const std::vector<double>& values) const;

  std::vector<std::string> parameters_;
  std::vector<std::string> warnings_;
  std::shared_ptr<const Scenes> scenes_;  // null with one pair
};

}  // namespace shearbus::service
