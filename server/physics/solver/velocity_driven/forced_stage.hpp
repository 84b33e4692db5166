// One stage of the step of layers with inertia under force (MODEL.md, "Layer inertia under force"): the layer lies between
// the masses of the host, and the slip at z = 0 heats.
#pragma once

#include <cstdint>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

namespace shearbus::physics {

// The soft half zone must have more mass than the layer, which it contains. And what lies behind either face must not be so
// light that it would swing more than 1e5 times in the step: the stress of such a face is the host's own to the last
// digits, and what the layer flows there is lost in them.
LeastMasses least_masses(const Problem& problem, double dt);

// Begins a step: the host's jump is the mean velocity of the layer and the mass behind it, and what the host has changed of
// it since the last step, it has changed of all.
void follow_host(const Problem& problem, const TileInputs& inputs, double* trial);

// As solve_stage().
std::uint32_t solve_forced_stage(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                                 std::uint32_t lanes, const WaveContacts& contacts, double* trial,
                                 Found (&found)[kLanes], const double* guess);

}  // namespace shearbus::physics
