// A scene of the user's own, as the studies take it: what a server would make of it, and the host its problem says.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "proto/wire/scene_file.hpp"
#include "tests/campaign/campaign.hpp"

namespace shearbus::study {

// Reads a scene that a server opens and that has a shear layer to study. Throws with expected, found and remedy, and
// the place in the file.
wire::SceneFile load_scene_with_layer(const std::filesystem::path& path);

// What the command line says of the host in the scene's place; absent: as the scene's problem, or else as in the paper.
struct HostGiven {
  std::optional<double> pressure;    // [Pa]
  std::optional<double> zone_width;  // of either body  [m]
  std::optional<double> dt;          // [s]
};

struct UserScene {
  stability::Physics physics;  // named as the scene is
  std::string text;            // what its physics is, for people
  std::string host;            // likewise its host, and who said so
};
UserScene user_scene(const wire::SceneFile& file, const HostGiven& given);

}  // namespace shearbus::study
