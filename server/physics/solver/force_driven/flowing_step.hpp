// The force-driven step with plastic strain (server/physics/MODEL.md, "Plastic layer"): DLP (48), (61), (64) and the
// interface law together.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes; the caller restores the states of the other lanes of `trial`.
void advance_force_driven_flowing(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
