// The velocity-driven step of layers with inertia (MODEL.md, "Layer inertia"): DLP (36) is solved together with heat
// and plastic flow. The host imposes the velocity jump at z = h, the hard body is at rest at z = 0, the stress follows
// from waves and plastic flow.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// A stress at z = 0 below this one, which only a layer that melts there has, is no stress: rounding decides its sign.
inline constexpr double kNoStress = 1.0;  // [Pa]

// One step of the active lanes; the caller restores the states of the other lanes of `trial`.
void advance_with_inertia(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);

// The same to second order in time: SDIRK2 for waves, plastic flow and heat together, two stages of the step above. A
// lane whose second stage starts from temperatures out of range, or has no answer, takes the step of first order instead
// and reports kFirstOrder.
void advance_with_inertia_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
