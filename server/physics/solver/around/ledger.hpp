// The energy ledger of a step (MODEL.md section 7b), computed from the states before and after the step and only on
// request.
#pragma once

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Writes the active lanes of `ledger` and leaves the others alone. Terms in [J/m2].
void record_energy(const Problem& problem, double dt, const TileInputs& inputs, const TileOutputs& outputs,
                   const double* committed, const double* trial, TileLedger& ledger);

}  // namespace shearbus::physics
