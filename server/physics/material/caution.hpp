// Known errors of the catalog's strengths, for warnings.
#pragma once

#include <string_view>

#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// Returns a sentence on the strength of the catalog's material `name`; empty if no error of it is known, or if
// `material` has another flow law, melting temperature or strength constant than the catalog.
std::string_view caution_of(std::string_view name, const Material& material);

}  // namespace shearbus::physics
