// The cost of a scene: the parts that it switches on and the parts that it leaves out. The memory of a part follows
// from the layout of the model; its time is measured on this machine. A node-step is one step of one node.
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

// The difference of two times that were measured in turns: the median of the differences, and the interval in which the
// median of many more would lie, with a probability of 96 % or more  [s].
struct TimeDifference {
  double median_s = 0.0;
  double low_s = 0.0;
  double high_s = 0.0;

  bool is_measured() const { return low_s > 0.0 || high_s < 0.0; }  // otherwise its sign is not known
  std::string text() const;                                         // such as "0.14 µs more (0.11 to 0.18)"
};
// Returns the difference of which these are samples. At least 6.
TimeDifference difference_of(std::vector<double> samples_s);

struct ScenePart {
  std::string name;                 // key of the part, for example "hard_layer"
  bool on = false;                  // true if the scene has the part
  std::string meaning;              // the physics that the part adds
  std::string excluded;             // reason why this scene cannot switch the part on or off; empty: it can
  std::int64_t bytes_per_node = 0;  // memory that the part adds, or would add
  TimeDifference slipping;          // time that the part adds, or would add, to a step of one slipping node
};

struct SceneCost {
  std::uint64_t bytes_per_node = 0;  // memory of states, entry in the index, and row in the last reply
  double slipping_s = 0.0;           // time of a node-step in which the interface slips
  double resting_s = 0.0;            // time of a node-step in which the contact is open and the layer still holds heat
  double step_length_s = 0.0;        // time to make the operators of a new step length
};

struct Explanation {
  std::string scene;
  SceneCost cost;
  std::vector<ScenePart> parts;
  SceneCost everything;               // cost of the scene with all compatible parts switched on
  std::vector<std::string> together;  // names of the parts that `everything` has in addition
  std::vector<std::string> pairs;     // names of the scene's pairs, of which the cost is not measured

  std::string text(std::size_t nodes = 0) const;  // `nodes` above 0: adds the cost of a step of this number of nodes
};

// Measures the time of every part on this machine, which takes about half a minute; says so on standard error, with a
// progress line on a terminal. Throws wire::Error for an invalid scene.
Explanation explain(std::string_view scene, const std::string& file);

// Throws wire::Error for a scene that no session can have.
void check_scene(std::string_view scene, const std::string& file);

// Optional physics that a run left out, and the memory that it would have needed. Nothing is measured.
struct OmittedCost {
  std::vector<std::string> parts;                    // parts that are off and could all be switched on together
  std::uint64_t bytes_per_node = 0;                  // memory of a node with the parts that the scene has
  std::uint64_t bytes_per_node_with_everything = 0;  // memory of a node with all compatible parts on
  std::optional<double> share_asleep;                // share of node-steps of sleeping nodes; absent: no node can sleep

  std::vector<std::pair<std::string, std::string>> lines() const;  // lines of a summary: label and text
};
OmittedCost omitted_cost(const std::string& effective_scene, const wire::SessionClosed& totals);

}  // namespace shearbus::server
