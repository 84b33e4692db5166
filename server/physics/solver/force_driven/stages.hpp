// The force-driven step of second order in time (METHODS.md).
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// An SDIRK2 step of the active lanes (nodes stepped together). It also overwrites the other lanes of `trial`, and the
// caller restores them. A lane to which SDIRK2 does not apply, for instance because its slip stops or reverses, takes a
// backward Euler step; its outcome then includes kFirstOrder, unless it sticks at the end.
void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
