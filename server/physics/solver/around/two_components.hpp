// Slip with two tangential components (MODEL.md, "Two tangential components"). Friction and plasticity are isotropic:
// the step is the scalar step along a trial vector, which is the elastic stress (velocity-driven) or the frictionless
// jump (force-driven).
#pragma once

#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Steps the active lanes by `advance`, which solves the scalar step along the trial vector of each lane.
void advance_two_components(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                            const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
