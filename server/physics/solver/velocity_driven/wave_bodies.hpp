// What lies behind the faces of a layer with inertia: velocities that are imposed or, under force, the masses of the host
// (MODEL.md, "Layer inertia under force").
#pragma once

#include <cstdint>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

namespace shearbus::physics {

// The bodies at the ends of the layers of a tile in one stage.
struct WaveEnds {
  double jump[kLanes];                         // velocity at z = h, of a body that gives way before the stage  [m/s]
  double give_near[kLanes], give_far[kLanes];  // WaveStep
};

// Velocity-driven.
WaveEnds imposed_ends(const TileInputs& inputs);

// Force-driven. follow_host() begins a step: the host's jump is the mean velocity of the layer and the mass behind it, and
// what the host has changed of it since the last step, it has changed of all.
void follow_host(const Problem& problem, const TileInputs& inputs, double* trial);

// Begins a stage of length dt: each face gives way as m dv/dt = (the host's force) - s. Returns the lanes whose host has
// no mass behind the layer.
std::uint32_t meet_bodies(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes,
                          const WaveContacts& contacts, double* trial, WaveEnds& ends);

// Ends it: the bodies have the velocities that their impulses leave them, and all are relative to the hard one again.
void leave_bodies(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes, double* trial);

}  // namespace shearbus::physics
