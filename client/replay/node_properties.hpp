// What nodes of a history have of their own from their registration on: initial temperature, pair, parameters.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/replay/table.hpp"
#include "proto/files/recording.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::replay {

// One value per node of a table, in the order of its nodes; an empty list stands for the values of the scene.
struct NodeProperties {
  std::vector<double> initial_temperature_k;
  std::vector<std::string> pair;                                        // name of each node's pair
  std::vector<std::pair<std::string, std::vector<double>>> parameters;  // by key of the scene, in the key's unit

  // Reads /initial_temperature, /pair and /parameter of a history. Throws Error for values that are none.
  static NodeProperties of(const Table& history);

  // Writes the datasets that of() reads.
  void write(files::HistoryWriter& writer) const;
};

// Refuses changes "KEY=VALUE" of a scene (--set, --sweep) of keys that nodes have values of their own of: these would hold
// on, and the change would be told of a result that it has no part in.
void refuse_changes_of_own(std::span<const std::string> changes, std::span<const std::string> own_keys);

// Follows the registrations of an event log.
class RegisteredProperties {
 public:
  // Follows an accepted request: its nodes, a mark, or the return to one.
  void follow(const wire::Request& request, const wire::Reply& reply);
  // Throws Error if the log does not tell the pair or a parameter of one of the nodes.
  NodeProperties of(std::span<const std::uint64_t> nodes) const;
  // Why a replay of the nodes begins otherwise than the log: a node has come from another session. Empty: it does not.
  std::string past_of(std::span<const std::uint64_t> nodes) const;

 private:
  struct Node {
    bool known = true;                   // false: it came from another session
    double initial_temperature_k = 0.0;  // 0: the scene's
    std::string pair;                    // empty: the tables outside of [pair.NAME]
    std::vector<double> parameters;      // empty: those of its pair
  };
  using Nodes = std::map<std::uint64_t, Node>;
  void add(const wire::Batch& batch, std::span<const std::string> pairs);
  Nodes& changed();  // the nodes, apart from those of the marks

  std::vector<std::string> keys_;
  bool several_ = false;  // whether the session has pairs or parameters
  std::string scene_;     // effective
  std::shared_ptr<Nodes> nodes_ = std::make_shared<Nodes>();
  std::map<std::string, std::shared_ptr<Nodes>> marks_;
};

}  // namespace shearbus::replay
