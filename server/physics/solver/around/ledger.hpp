// Where the energy of a step went (MODEL.md section 7b). Computed from the states before and after it, and only for
// those who ask.
#pragma once

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// The active lanes of `ledger`; the others are left alone. `second`, `second_outputs`: null with one component.
void book_step(const Problem& problem, double dt, const TileInputs& inputs, const TileOutputs& outputs,
               const SecondInputs* second, const SecondOutputs* second_outputs, const double* committed,
               const double* trial, TileLedger& ledger);

}  // namespace shearbus::physics
