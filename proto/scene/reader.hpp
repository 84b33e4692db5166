// Reads TOML text into one checked message of any root type, by reflection: the .proto is the only schema. This file is
// for programs that have a root message of their own; scene.hpp reads shearbus.v1.Scene.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/scene/rules.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::scene {

// The file name of a text, for messages, and the place of each of its keys.
struct Document {
  std::string file;
  std::map<std::string, Place, std::less<>> places;  // places of the keys, by path ("layer.cells")

  // Returns the place of a key, "paper.toml:12:1". If the key is absent, returns the place of the nearest enclosing
  // table; if there is none either, the file name alone.
  std::string where(std::string_view path) const;

  // Throws wire::Error{kInvalidScene} with a line "file:line:column: text" for each fault, in the order of the text.
  // After 50 faults, one line states the number of the others. The field of the error is the path of the first fault.
  [[noreturn]] void refuse(const std::vector<Fault>& faults, std::string remedy = {}) const;

  // Returns the status. If its code is INVALID_SCENE and its text does not begin with the name of this file, the place
  // of the key that the status names is put in front of the text.
  wire::Status placed(wire::Status status) const;

 private:
  std::optional<Place> place_of_path(std::string_view path) const;
  Place place_of_fault(const Fault& fault) const;
};

// A function that checks the rules between several keys. `root` has its defaults filled in.
using CrossRules = std::function<void(const google::protobuf::Message& root, Findings& findings)>;

// Reads a text into an empty message, checks it and fills in its defaults. Throws wire::Error{kInvalidScene}. Of a text
// that is not TOML the error names the first syntax error. Otherwise the error lists all faults: unknown keys (with the
// nearest known key), wrong types, missing and out-of-range values, and violated rules between keys. For example
//   paper.toml:12:1: layer.cels is not a key of [layer]; did you mean "cells"?
Document read(std::string_view text, const std::string& file, google::protobuf::Message& root,
              const CrossRules& cross_rules);

// Returns the text of a scene's file. Throws wire::Error{kInvalidScene} if the file cannot be read or is larger than
// kMaxSceneBytes.
std::string read_file(const std::filesystem::path& path);

// Returns the text of a scene's file as the server reads it: without the table [hydro], which only shearbus-hydro
// reads.
std::string load_text(const std::filesystem::path& path);

// Returns the text without a top-level key or table and everything inside it. The removed lines stay as empty lines, so
// that the line numbers of all other lines hold. Throws wire::Error{kInvalidScene} if the text is not TOML.
std::string without_table(std::string_view text, const std::string& file, std::string_view key);

// Returns the text with one key set: `assignment` is "table.key=value", the value as in TOML or a bare word. Comments
// and the order of keys are lost. `origin` names the assignment in messages. Throws wire::Error{kInvalidScene} if text
// or assignment is not TOML.
std::string with_value(std::string_view text, const std::string& origin, std::string_view assignment);

// Returns the message as canonical TOML: keys in the order of the schema, each with a comment of its unit and meaning;
// numbers read back to the same bits. Throws wire::Error{kInvalidScene} for an enum value without a name.
std::string to_toml(const google::protobuf::Message& root);

// Returns the value of a field of a message, which is no table, as such a text has it.
std::string value_text(const google::protobuf::Message& message, const google::protobuf::FieldDescriptor& field);

// Returns a reference of every key of a root message, as Markdown: table, key, type, unit, default, bounds, meaning.
std::string reference_of(const google::protobuf::Descriptor& root);

}  // namespace shearbus::scene
