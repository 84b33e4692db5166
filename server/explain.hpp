// The cost of a scene: the parts it switches on and those it leaves out, each with its memory, from the layout of the
// model, and its time, measured on this machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/wire/messages.hpp"

namespace shearbus::server {

struct ScenePart {
  std::string name;                 // "hard_layer"
  bool on = false;                  // the scene asks for it
  std::string meaning;              // the physics that it adds
  std::string excluded;             // why this scene could not be without it, or with it; empty: it could
  std::int64_t bytes_per_node = 0;  // that it takes, or would take
  double slipping_s = 0.0;          // that it adds, or would add, to a node-step
};

struct SceneCost {
  std::uint64_t bytes_per_node = 0;  // both states, index and kept reply
  double slipping_s = 0.0;           // of a node-step
  double resting_s = 0.0;            // of a node-step of an open contact that holds heat
  double step_length_s = 0.0;        // of the operators of a new step length
};

struct Explanation {
  std::string scene;
  SceneCost cost;
  std::vector<ScenePart> parts;
  SceneCost everything;               // all parts on that go together
  std::vector<std::string> together;  // the names of those

  std::string text(std::size_t nodes = 0) const;  // 0: of one node
};

// Measures every part on this machine, for a second at most. Throws wire::Error where the scene is not in order.
Explanation explain(std::string_view scene, const std::string& file);

// Optional physics that a run left out, and the memory it would have taken. Nothing is measured.
struct OmittedCost {
  std::vector<std::string> parts;                    // that are off and could all be on together
  std::uint64_t bytes_per_node = 0;                  // of the scene as it is
  std::uint64_t bytes_per_node_with_everything = 0;  // with all parts that go together
  std::optional<double> share_asleep;                // of the node-steps; absent: the scene has no sleep

  std::vector<std::pair<std::string, std::string>> lines() const;  // of a summary: label and text
};
OmittedCost omitted_cost(const std::string& effective_scene, const wire::SessionClosed& totals);

}  // namespace shearbus::server
