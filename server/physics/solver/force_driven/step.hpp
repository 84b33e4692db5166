// The force-driven step without flow of the layer (server/physics/MODEL.md, "Force-driven step"): DLP (61), (65). The
// host sends far-field stresses, the interface law finds the slip. The only plastic strain is that of junctions
// (MODEL.md, "Junctions").
#pragma once

#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Steps the active lanes by backward Euler, or by the exact decay of the modes. A step that may have several answers is
// divided into substeps. The caller restores the states of the other lanes of `trial`.
void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);

// The step of a sleeping lane, by the same function as the step of a lane that is awake. Empty if slip, heat or a step
// that may have several answers wakes the lane.
std::optional<RestingStep> force_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                     const TileInputs& inputs, const double* committed,
                                                     const Material& soft, double T0, int lane);

}  // namespace shearbus::physics
