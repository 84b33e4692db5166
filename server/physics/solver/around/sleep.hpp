// Nodes at rest (server/physics/MODEL.md section 3b): an open contact, or one that sticks without friction heat and
// whose layer certainly does not flow, is not solved. After some steps at rest its temperatures are turned into
// amplitudes of the heat's modes, in place; from then on a step is a product per living mode, and gives T0. The first
// step that would bring heat, or might bring flow, turns them back and solves as ever. What a lane does here depends on
// its own state and inputs alone.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Turning there and back costs about as much as so many ordinary steps save: a lane that may be about to move waits.
int steps_before_sleep(int num_heat_vertices);

// Whether the rows of this lane's temperatures hold amplitudes.
inline bool asleep(const TileLayout& layout, const double* tile, int lane) {
  return layout.resting != TileLayout::kAbsent && tile[layout.resting + kLanes + lane] != 0.0;
}

double interface_temperature(const Problem& problem, const double* tile, int lane);

// The temperatures of a lane, asleep or not, as [vertex][lane].
void profile_of(const Problem& problem, const double* tile, int lane, double* temperature);

using AdvanceTile = void (*)(const Problem&, const StepOperators&, const TileInputs&, const double*, double*,
                             TileOutputs&);
// One step of the active lanes, those that are awake by `awake`.
void advance_with_sleep(const Problem& problem, const StepOperators& operators, AdvanceTile awake,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
