// A scene as received, to the model that runs it.
#pragma once

#include "proto/wire/scene.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

struct SceneModel {
  wire::Scene effective;  // every default and material constant filled in; the guest's tables dropped
  physics::ModelOptions options;
};

// Throws wire::Error{kInvalidScene} whose field is the path of the key at fault ("soft.yield_strength_pa").
SceneModel scene_model(const wire::Scene& scene);

}  // namespace shearbus::service
