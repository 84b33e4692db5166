// Scenes as TOML files, mapped onto the scene message by protobuf reflection: the .proto is the only schema.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/scene.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::wire {

// A scene and where each of its fields stands in the file.
struct SceneFile {
  Scene scene;
  std::string file;
  std::map<std::string, std::string, std::less<>> places;  // "layer.cells" -> "12:1"

  // "paper.toml:12:1", for a field path such as a server's error names; the nearest enclosing table, or the file alone.
  std::string where(std::string_view field) const;
};

// Reads and checks a scene against the rules of the schema: unknown keys (with the nearest known one), wrong types,
// missing and out-of-range values. Throws Error{kInvalidScene} whose text lists every fault, one line each:
//   paper.toml:12:1: layer.cels is not a key of [layer]; did you mean "cells"?
SceneFile load_scene_file(const std::filesystem::path& path);
SceneFile parse_scene(std::string_view toml, std::string file_name);

// The same checks on a scene that did not come from a file (as a server receives it); field names the first fault.
Status check_scene(const Scene& scene);

// The scene as TOML with a comment of unit and meaning at each key; parse_scene reads it back to the same scene, bit
// for bit.
std::string scene_to_toml(const Scene& scene);

// A reference of every key: table, key, type, unit, default, bounds, meaning. As Markdown.
std::string scene_reference();

}  // namespace shearbus::wire
