// Which values of the options of a model are allowed: the limits of one option, or of an option and its values. What
// options exclude each other is in parts.hpp.
#pragma once

#include <vector>

#include "server/physics/solver/parts.hpp"

namespace shearbus::physics {

void add_refused_values(const ModelOptions& options, std::vector<Refusal>& found);

}  // namespace shearbus::physics
