// The layer of one node, vertex by vertex, as its state has it: for pictures and comparison, no part of a step.
#pragma once

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Whether the model has a temperature at every vertex. A model with heat modes has only T0.
bool keeps_profile(const Problem& problem);

// The vertices of a conducting hard body, of the layer, and of a half-space behind the layer.
ProfileGrid profile_grid(const Problem& problem);

// Writes the profile of the node in one lane, vertices in ascending z. `pressure` is the P at which the flow stress is
// evaluated  [Pa].
void read_profile(const Problem& problem, const double* tile, int lane, double pressure, const ProfileRows& rows);

}  // namespace shearbus::physics
