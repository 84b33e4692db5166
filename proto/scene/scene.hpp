// Converts scenes: from TOML text to the checked message shearbus.v1.Scene, and back to canonical text.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/scene/reader.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::scene {

struct SceneFile {
  v1::Scene scene;  // the scene with its defaults filled in
  std::string text;
  Document document;
};

// Read a scene from its text or from its file. Both throw wire::Error{kInvalidScene} that lists the faults, as read()
// does.
SceneFile parse(std::string text, const std::string& file);
SceneFile load(const std::filesystem::path& path);

// Reads a scene into an empty message of the caller; otherwise it does the same as parse(). The faults that `more` finds
// are listed with the others.
using MoreRules = void (*)(const v1::Scene& scene, Findings& findings);
Document read(std::string_view text, const std::string& file, v1::Scene& scene, MoreRules more = nullptr);

// Checks the rules between keys that the schema cannot express. The defaults of `scene` must be filled in. A rule is
// skipped if a value that it needs is at fault. Which options exclude each other is not checked here but in the physics
// (server/physics/solver/parts.hpp).
void check_scene(const v1::Scene& scene, Findings& findings);

// Returns the scene without its pairs.
v1::Scene without_pairs(const v1::Scene& scene);

// Returns the scene of one pair alone: the tables of the pair in place of those of `scene`, which has no pairs.
v1::Scene scene_of_pair(const v1::Scene& scene, const v1::Pair& pair);

// Makes `pair` the pair whose scene is `whole`: those tables that differ from the scene's.
void set_pair(const v1::Scene& scene, const v1::Scene& whole, v1::Pair& pair);

// A key whose value or presence differs in two scenes without pairs, as "layer.cells"; empty: there is none. Keys for
// which may_differ(path, is_number) is true are left out.
using MayDiffer = bool (*)(std::string_view path, bool is_number);
std::string first_difference(const v1::Scene& a, const v1::Scene& b, MayDiffer may_differ);

// The number of the number-valued key `path`, as "interface.friction_coefficient"; null: no table of the scene has such
// a key.
const google::protobuf::FieldDescriptor* find_number(std::string_view path);
// Reads or sets it. value_of() has no value if the key or its table is absent.
std::optional<double> value_of(const v1::Scene& scene, std::string_view path);
void set_value(v1::Scene& scene, std::string_view path, double value);

// Returns all faults of a scene that does not come from a text. Fills in the defaults of the scene.
std::vector<Fault> faults_of(v1::Scene& scene);

// Returns the numbers of a table with their names in a scene ("density_kg_per_m3", ...), in the order of the schema.
std::vector<std::pair<std::string, double>> numbers_of(const google::protobuf::Message& table);
// Sets numbers of a table by their names. Throws std::invalid_argument for a name that is not that of a number in the
// table.
void set_numbers(const std::vector<std::pair<std::string, double>>& numbers, google::protobuf::Message& table);

}  // namespace shearbus::scene
