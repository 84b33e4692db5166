// The force-driven step of second order in time (METHODS.md).
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes; the caller restores the states of the other lanes of `trial`. A lane to which SDIRK2
// does not apply, for instance because its slip stops or reverses, takes a backward Euler step. If it does not stick at
// the end of that step it reports kFirstOrder.
void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
