// The rules of the schema (the `rule` option of every field) held against a scene message.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace google::protobuf {
class FieldDescriptor;
}
namespace shearbus::v1 {
class Scene;
}

namespace shearbus::wire {

struct Fault {
  std::string path;  // "layer.cells": where it stands, or the table that lacks it
  std::string text;  // one line, naming the key
};

// Every fault of the scene's values: missing, out of bounds, not finite, at odds with each other. `given(path)` tells
// of keys that were given but did not make it into the message: they are not reported as missing.
std::vector<Fault> faults_of(const v1::Scene& scene, const std::function<bool(std::string_view path)>& given);

// "above 0 and at most 1 m", "at least 1"; empty where the field has no bounds.
std::string bounds_of(const google::protobuf::FieldDescriptor& field);

// Names of an enum field's values as scenes write them, in order: "velocity_driven", "force_driven".
std::vector<std::string> choices_of(const google::protobuf::FieldDescriptor& field);

// A number as text that reads back to the same bits, e.g. "2e-05".
std::string number_text(double value);

}  // namespace shearbus::wire
