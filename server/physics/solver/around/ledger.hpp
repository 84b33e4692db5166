// The energy ledger of a step (MODEL.md, "Energy ledger"), computed from the states before and after the step and only
// on request.
#pragma once

#include <array>

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

using LaneValues = std::array<double, kLanes>;

// Growth of the heat in the bodies over a step  [J/m2].
struct StoredHeat {
  LaneValues soft{}, hard{};
};
// The growth of the heat computed from rows of temperature or modes, [row][lane], of lanes that are awake. `entered`:
// friction heat, [lane].
StoredHeat stored_in_rows(const Problem& problem, const double* T_old, const double* T_new, const double* entered);

// Writes the active lanes of `ledger` and leaves the others alone. Terms in [J/m2].
void record_energy(const Problem& problem, double dt, const TileInputs& inputs, const TileOutputs& outputs,
                   const double* committed, const double* trial, TileLedger& ledger);

}  // namespace shearbus::physics
