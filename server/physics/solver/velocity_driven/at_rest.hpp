// The velocity-driven step of a lane that neither heats nor flows (METHODS.md, sleep).
#pragma once

#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Solves the step of a sleeping lane as elastic. The caller checks that no vertex yields under the returned stress.
// Returns nothing if the lane must wake: if it heats, exceeds its Coulomb limit or fails velocity_driven_may_rest().
std::optional<RestingStep> velocity_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                        const TileInputs& inputs, const double* committed,
                                                        const Material& soft, double T0, int lane);

// Whether a lane may rest. With the drive INTERFACE_SLIP it may not rest under a velocity jump, because such a step can
// start from the yield stress instead of the old stress.
bool velocity_driven_may_rest(const Problem& problem, const TileInputs& inputs, int lane);

}  // namespace shearbus::physics
