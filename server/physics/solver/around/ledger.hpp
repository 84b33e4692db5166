// The heat stored in a step, for the energy ledger (MODEL.md, "Energy ledger"), which is computed from the states
// before and after the step and only on request.
#pragma once

#include <array>

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

using LaneValues = std::array<double, kLanes>;

// Growth of the heat stored in each body over a step, [lane]  [J/m2].
struct StoredHeat {
  LaneValues soft{}, hard{};
};
// Growth of the heat stored in the bodies, from the temperatures of the vertices (or the modes) before and after a
// step, [vertex or mode][lane]. Not for sleeping nodes. `entered`: friction heat of the step, [lane]  [J/m2].
StoredHeat stored_in_rows(const Problem& problem, const double* T_old, const double* T_new, const double* entered);

}  // namespace shearbus::physics
