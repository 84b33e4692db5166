// The bodies behind the faces of layers with inertia: with an imposed velocity, or under force masses of the host
// (MODEL.md, "Layer inertia under force").
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

// Begins a stage: the bodies at its ends, under force each with m dv/dt = (the host's force) - s. Returns the lanes whose
// host has too little mass.
std::uint32_t meet_bodies(const InertiaStage& stage, std::uint32_t lanes, WaveEnds& ends);

// Ends it: under force the bodies have the velocities that their impulses leave them, and all are relative to the hard one
// again.
void leave_bodies(const InertiaStage& stage, std::uint32_t lanes);

}  // namespace shearbus::physics
