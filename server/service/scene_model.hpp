// Converts a scene to the options of its model.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "server/shard/shard.hpp"

namespace shearbus::v1 {
class Scene;
}

namespace shearbus::service {

// A pair [pair.NAME] of a scene.
struct PairModel {
  std::string name;
  physics::ModelOptions options;
  std::vector<std::string> warnings;  // of its model
};

struct SceneModel {
  physics::ModelOptions options;
  std::string name;                        // name of the scene
  std::string effective;                   // canonical TOML text with every default and material constant filled in
  bool friction_energy = false;            // nodes sum the friction heat of either body
  std::vector<PairModel> pairs;            // in the order of the effective text
  std::shared_ptr<const v1::Scene> scene;  // the effective scene
  // values of the effective scene that were probably meant in another unit
  std::vector<std::string> warnings;
};

// Reads, checks and converts a scene's text. Throws wire::Error{kInvalidScene} with a line "file:line:column: ..." for
// each fault; the field of the error is the path of the first key at fault ("soft.yield_strength_pa").
SceneModel scene_model(std::string_view text, const std::string& file);

// Checks and converts a scene that is not from a text: its faults are reported without line numbers. Without `warn` it
// has no warnings, which take longer than the rest: for sets of parameters, of which a request may bring thousands.
SceneModel scene_model(const v1::Scene& scene, bool warn = true);

// Whether the model has the energy ledger, which friction_energy sums: one stress, and no heat that leaves.
bool has_ledger(const physics::ModelOptions& options);

// The text of an effective scene without its keys `name` and `source`. Two sessions may exchange states if these texts
// are equal.
std::string_view layers_of(std::string_view effective);

}  // namespace shearbus::service
