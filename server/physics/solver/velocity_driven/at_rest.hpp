// The velocity-driven step of a lane that neither heats nor flows (METHODS.md, sleep).
#pragma once

#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// The step of a sleeping lane, whose stress is the elastic trial stress; the caller checks that no vertex yields under
// this stress. Empty if the lane heats, would exceed its Coulomb limit or may start from the yield stress.
std::optional<RestingStep> velocity_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                        const TileInputs& inputs, const double* committed,
                                                        const Material& soft, double T0, int lane);

// Whether a lane may rest. With INTERFACE_SLIP a step under a jump never counts as rest, because it may start from the
// yield stress.
bool velocity_driven_may_rest(const Problem& problem, const TileInputs& inputs, int lane);

}  // namespace shearbus::physics
