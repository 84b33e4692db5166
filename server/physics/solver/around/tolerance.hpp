// Step control: divides a step into substeps until the estimated error of T0 is below the tolerance (METHODS.md).
#pragma once

#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes in as many substeps as the tolerance needs; after a limit of attempts the rest of the
// step is accepted unchecked. `advance` solves one substep. Writes the whole of `trial`. Lanes without an answer keep
// their state.
void advance_controlled(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

// The largest number of times that a step of dt may be halved.
int most_times_halved(double dt);

}  // namespace shearbus::physics
