// A user's scene for the studies: the physics model that a server would make of it, and the host's pressure, zones and
// step length.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "hydro_stub/scene.hpp"
#include "tests/campaign/campaign.hpp"

namespace shearbus::study {

// Reads a scene. Throws if the scene has no shear layer or if a server would refuse the scene. The message of the
// exception contains the expected and the found value, a remedy and the place in the file.
hydro::SceneFile load_scene_with_layer(const std::filesystem::path& path);

// Properties of the host that the command line gives. A property that it does not give comes from the hydrocode problem
// in the scene or, if the scene has no such problem, from the paper.
struct HostGiven {
  std::optional<double> pressure;    // pressure on the interface  [Pa]
  std::optional<double> zone_width;  // zone width of both bodies  [m]
  std::optional<double> dt;          // step length  [s]
};

struct UserScene {
  stability::Physics physics;  // model options and host; its name is that of the scene
  std::string text;            // description of the physics, for the report
  std::string host;            // description of the host and of the source of its values, for the report
};
UserScene user_scene(const hydro::SceneFile& file, const HostGiven& given);

}  // namespace shearbus::study
