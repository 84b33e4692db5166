// What measurements say against a metal of the catalog in the state to which friction brings it.
#pragma once

#include <string_view>

#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// Returns a sentence on the strength of the catalog's material `name`; empty if nothing is known against it, or if
// `material` has a strength of its own.
std::string_view caution_of(std::string_view name, const Material& material);

}  // namespace shearbus::physics
