// The force-driven step of second order in time (METHODS.md).
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes; the rest of `trial` is left for the caller. Lanes whose slip stops or reverses in the
// step take a backward Euler step and report it (kFirstOrder).
void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
