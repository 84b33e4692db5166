// Describes in one sentence the grid and the methods of a model with a tolerance (METHODS.md, "Tolerance").
#pragma once

#include <cstddef>
#include <string>

#include "server/physics/solver/options.hpp"

namespace shearbus::physics {

// Returns the description for the user, as one sentence. `modes`: number of heat modes, 0 with a temperature profile.
std::string discretisation_of(const ModelOptions& options, std::size_t modes);

}  // namespace shearbus::physics
