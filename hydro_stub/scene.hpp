// A scene of shearbus-hydro in one TOML file: the keys that the server reads, and the table [hydro] of the hydrocode.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "hydro_stub/hydro.pb.h"
#include "proto/scene/reader.hpp"

namespace shearbus::hydro {

struct SceneFile {
  guest::HydroScene scene;  // the scene, with its defaults filled in
  std::string text;
  scene::Document document;

  // Returns the text for the server, without [hydro]. Every other key stays on its original line, as messages name
  // lines.
  std::string server_text() const;

  // Returns warnings, each with its place: numbers of [hydro] that were probably meant in another unit. The server warns
  // of the other tables.
  std::vector<std::string> warnings() const;
};

// Read a scene from its text or its file. Throw wire::Error{kInvalidScene} that lists every fault of the scene.
SceneFile parse_scene(std::string text, const std::string& file);
SceneFile load_scene(const std::filesystem::path& path);

// Whether the problem of a scene is one in two dimensions.
bool has_problem2d(const guest::Hydro& hydro);

// The names of the interface laws in scenes: "subgrid", "coulomb_tresca", ...
const std::vector<std::string>& interface_laws();
const std::string& name(guest::InterfaceLaw law);
guest::InterfaceLaw interface_law(const std::string& name);  // of one of these names

// Returns the reference of every key of a scene, as Markdown.
std::string reference();

}  // namespace shearbus::hydro
