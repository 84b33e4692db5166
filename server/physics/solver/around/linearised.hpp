// The linearised answer of a solved step (MODEL.md, "Linearised answer"): derivatives of the stress by inputs of the
// host, and the time to melting. Computed only on request; changes no state and no other answer.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Returns true if the answers of a model with these options can be linearised: one balance gives one stress, at the end
// of an undivided step.
bool can_linearise(const ModelOptions& options);

// Writes the derivatives of the answered stress of the active lanes: stress_per_jump and stress_per_pressure of
// `outputs`. They are 0 where the answer has none: open contacts, lanes that failed, and lanes whose step was divided
// into substeps. Only for models that can_linearise() allows.
void linearise(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
               const double* committed, const double* trial, TileOutputs& outputs);

// Writes time_to_melting of the active lanes: the time after the step in which T0 reaches T_melt if it goes on rising
// at the mean rate of the step; infinity where T0 does not rise.
void predict_melting(const Problem& problem, const TileInputs& inputs, double dt, const double* committed,
                     TileOutputs& outputs);

}  // namespace shearbus::physics
