// The velocity-driven step of second order in time (METHODS.md).
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Takes one SDIRK2 step of the active lanes; the caller restores the states of the other lanes of `trial`. The second
// stage extrapolates temperatures from the first. A lane in which one of them falls below the coldest old temperature
// or reaches melting takes a backward Euler step instead and reports kFirstOrder.
void advance_velocity_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                    const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
