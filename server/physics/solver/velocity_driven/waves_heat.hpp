// Plastic work that heats in place in a layer with inertia (MODEL.md, "Layer inertia").
#pragma once

#include <cstdint>

#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

namespace shearbus::physics {

// A step of backward Euler as by solve_stage(), whose work heats where it is done: plastic work with the Taylor-Quinney
// fraction at its vertex, slip of the interface whole at z = 0. Returns the lanes that have no answer. In the others all
// temperatures are those at the end of the step, and Found::flux is the heat that all work of the step becomes.
std::uint32_t solve_heated_stage(const StepOperators& operators, const InertiaStage& stage, const double* committed,
                                 std::uint32_t lanes);

}  // namespace shearbus::physics
