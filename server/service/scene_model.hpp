// Converts a scene to the options of its model.
#pragma once

#include <string>
#include <string_view>

#include "server/shard/shard.hpp"

namespace shearbus::v1 {
class Scene;
}

namespace shearbus::service {

struct SceneModel {
  physics::ModelOptions options;
  std::string name;       // of the scene
  std::string effective;  // canonical TOML text with every default and material constant filled in
};

// Reads, checks and converts a scene's text. Throws wire::Error{kInvalidScene} with a line "file:line:column: ..." for each fault; its field is
// the path of the first key at fault ("soft.yield_strength_pa").
SceneModel scene_model(std::string_view text, const std::string& file);

// The same of a message that does not come from a text: the faults have no place.
SceneModel scene_model(const v1::Scene& scene);

// An effective scene without its name and source: equal where states of one session may be states of the other.
std::string_view layers_of(std::string_view effective);

}  // namespace shearbus::service
