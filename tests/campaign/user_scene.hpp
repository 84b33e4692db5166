// A scene of the user for the studies: the model that a server would make of it, and the host of its problem.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "hydro_stub/scene.hpp"
#include "tests/campaign/campaign.hpp"

namespace shearbus::study {

// Reads a scene with a shear layer and requires that a server would open it. Throws with the expected and the found
// value, a remedy and the place in the file.
hydro::SceneFile load_scene_with_layer(const std::filesystem::path& path);

// Properties of the host from the command line. Absent properties come from the scene's problem, or from the paper if
// the scene has none.
struct HostGiven {
  std::optional<double> pressure;    // [Pa]
  std::optional<double> zone_width;  // zone width of both bodies  [m]
  std::optional<double> dt;          // [s]
};

struct UserScene {
  stability::Physics physics;  // has the name of the scene
  std::string text;            // description of the physics
  std::string host;            // description of the host and the origin of its values
};
UserScene user_scene(const hydro::SceneFile& file, const HostGiven& given);

}  // namespace shearbus::study
