// The force-driven step without flow of the layer (server/physics/MODEL.md, "Force-driven step"): DLP (61), (65). The
// host sends far-field stresses, the interface law finds the slip. The only plastic strain is that of junctions
// (MODEL.md, "Junctions").
#pragma once

#include <cstddef>
#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Distance in doubles to the rows of the next tile where tiles stand one behind the other, each with both its buffers,
// as in the server's shard. Elsewhere memory is asked for in vain, which changes no answer.
inline std::ptrdiff_t distance_to_next_tile(const TileLayout& layout) {
  return 2 * static_cast<std::ptrdiff_t>(layout.doubles);
}

// Steps the active lanes by backward Euler, or, in a scene with heat = "modes", by the exact decay of the modes of heat
// conduction. A step that may have several answers is divided into substeps. The function overwrites inactive lanes of
// `trial` too; the caller restores them.
void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);

// The step of one lane (node) that sleeps: it is at rest, and its temperatures follow from eigenmodes. Returns nothing
// if the lane must wake because it slips, is heated, or may have several answers.
std::optional<RestingStep> force_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                     const TileInputs& inputs, const double* committed,
                                                     const Material& soft, double T0, int lane);

}  // namespace shearbus::physics
