// Step control: divides a step into substeps until the estimated error of T0 is below the tolerance (METHODS.md).
#pragma once

#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes (nodes stepped together) in as many substeps as the tolerance needs. After kMostAttempts
// substeps the rest of the step is accepted whatever its error. `advance` solves one substep. Writes all lanes of
// `trial`; a lane without an answer keeps its state.
void advance_controlled(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

// The largest number of times that a step of dt may be halved.
int most_times_halved(double dt);

}  // namespace shearbus::physics
