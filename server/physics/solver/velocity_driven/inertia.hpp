// The velocity-driven step of layers with inertia (MODEL.md, "Layer inertia"): DLP (36) is solved together with heat
// and plastic flow. The host imposes the velocity jump at z = h, the hard body is at rest at z = 0, the stress follows
// from waves and plastic flow.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes; the caller restores the states of the other lanes of `trial`.
void advance_with_inertia(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
