// The velocity-driven step of second order in time (METHODS.md).
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes; the caller restores the states of the other lanes of `trial`. A lane whose extrapolated
// temperatures fall below the coldest old temperature or reach melting takes a backward Euler step and reports
// kFirstOrder.
void advance_velocity_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                    const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
