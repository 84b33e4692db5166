// The cost of a scene: the parts that it switches on and the parts that it leaves out, each with its memory, from the
// layout of the model, and its time, measured on this machine.
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
  bool on = false;                  // whether the scene has the part
  std::string meaning;              // the physics that it adds
  std::string excluded;             // reason why this scene cannot switch the part; empty: it can
  std::int64_t bytes_per_node = 0;  // memory of the part, or what it would need
  double slipping_s = 0.0;          // time that the part adds, or would add, to a node-step
};

struct SceneCost {
  std::uint64_t bytes_per_node = 0;  // both states, index and kept reply
  double slipping_s = 0.0;           // time of a node-step in which the interface slips
  double resting_s = 0.0;            // time of a node-step of an open contact that holds heat
  double step_length_s = 0.0;        // time to make the operators of a new step length
};

struct Explanation {
  std::string scene;
  SceneCost cost;
  std::vector<ScenePart> parts;
  SceneCost everything;               // cost with all compatible parts
  std::vector<std::string> together;  // names of these parts

  std::string text(std::size_t nodes = 0) const;  // 0: text for one node
};

// Measures every part on this machine, for at most a second. Throws wire::Error if the scene is not valid.
Explanation explain(std::string_view scene, const std::string& file);

// Optional physics that a run left out, and the memory that it would have needed. Nothing is measured.
struct OmittedCost {
  std::vector<std::string> parts;                    // parts that are off and could all be on together
  std::uint64_t bytes_per_node = 0;                  // memory of the scene as it is
  std::uint64_t bytes_per_node_with_everything = 0;  // memory with all compatible parts
  std::optional<double> share_asleep;                // fraction of the node-steps; absent: the scene has no sleep

  std::vector<std::pair<std::string, std::string>> lines() const;  // lines of a summary: label and text
};
OmittedCost omitted_cost(const std::string& effective_scene, const wire::SessionClosed& totals);

}  // namespace shearbus::server
