// Scenes that differ from another one in a few keys.
#pragma once

#include <google/protobuf/text_format.h>

#include <stdexcept>
#include <string>

#include "proto/scene/scene.hpp"

namespace shearbus::support {

// Returns the scene with changes, which are written as in protobuf's text format: "layer { cells: 5 } tolerance: 0.1".
inline v1::Scene with(v1::Scene scene, const std::string& changes) {
  if (!google::protobuf::TextFormat::MergeFromString(changes, &scene))
    throw std::invalid_argument("not the changes of a scene: " + changes);
  return scene;
}

}  // namespace shearbus::support
