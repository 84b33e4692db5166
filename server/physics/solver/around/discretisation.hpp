// What a tolerance is made of in place of cells and methods (METHODS.md, "Tolerance").
#pragma once

#include <cstddef>
#include <string>

#include "server/physics/solver/options.hpp"

namespace shearbus::physics {

// One sentence for the user. `modes`: how many there are.
std::string discretisation_of(const ModelOptions& options, std::size_t modes);

}  // namespace shearbus::physics
