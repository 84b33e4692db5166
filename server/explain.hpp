// What a scene pays for: the parts it switches on and those it leaves out, with what each costs in memory, by the model
// itself, and in time, measured here and now. A second at most.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/messages.hpp"

namespace shearbus::v1 {
class Scene;
}

namespace shearbus::server {

struct ScenePart {
  std::string name;                 // "hard_layer"
  bool on = false;                  // the scene asks for it
  std::string meaning;              // what it brings
  std::string excluded;             // why this scene could not have it; empty: it could
  std::int64_t bytes_per_node = 0;  // it takes, or would take
  double slipping_s = 0.0;          // it adds, or would add, to a node-step
};

struct SceneCost {
  std::uint64_t bytes_per_node = 0;  // both states, index and kept reply
  double slipping_s = 0.0;           // a node-step
  double resting_s = 0.0;            // of an open contact that holds heat
  double step_length_s = 0.0;        // a step length that was not there before, once
};

struct Explanation {
  std::string scene;
  SceneCost cost;
  std::vector<ScenePart> parts;
  SceneCost everything;               // all parts on that go together
  std::vector<std::string> together;  // the names of those

  std::string text(std::size_t nodes = 0) const;  // 0: of one node
  // Parts that are off and would go together with what is on.
  std::vector<std::string> left_out() const;
};

// `each_part`: with what every single part costs; else only which are on, and the cost of all. Throws wire::Error where
// the scene is not in order.
Explanation explain(const v1::Scene& scene, bool each_part = true);
Explanation explain(std::string text, std::string file, bool each_part = true);

// What a run was spared, for its summary.
struct Spared {
  std::vector<std::pair<std::string, std::string>> lines;  // label and text
  std::string json;                                        // an object of the same numbers
};
// Times are measured on this machine; `here`: where the layers were computed as well.
Spared spared(const std::string& effective_scene, const wire::SessionClosed& totals, bool here);

}  // namespace shearbus::server
