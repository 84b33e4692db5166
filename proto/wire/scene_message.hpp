// Scene values to the scene message and back: the one place that knows both.
#pragma once

#include "proto/wire/scene.hpp"

namespace shearbus::v1 {
class Scene;
}

namespace shearbus::wire {

// Throws Error{kInvalidScene} naming the field where the values have no message: a constant of a body that no material
// has or that is given twice, text that is not UTF-8.
void to_message(const Scene& scene, v1::Scene& message);

// Absent numbers of the tables that are present, and of [layer], take the default their rules name.
void fill_defaults(v1::Scene& message);

// Absent fields take the default their rule names; nothing is checked.
Scene from_message(const v1::Scene& message);

}  // namespace shearbus::wire
