// The velocity-driven step of a lane that neither heats nor flows (METHODS.md, sleep).
#pragma once

#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// The elastic trial, which is the answer of the velocity-driven step where nothing yields under it. Empty if the lane
// heats, is at its Coulomb limit or starts from the yield stress.
std::optional<RestingStep> velocity_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                        const TileInputs& inputs, const double* committed,
                                                        const Material& soft, double T0, int lane);

// Whether a lane may rest. INTERFACE_SLIP under a jump starts from the stress of a layer at yield: such a step is never
// rest.
bool velocity_driven_may_rest(const Problem& problem, const TileInputs& inputs, int lane);

}  // namespace shearbus::physics
