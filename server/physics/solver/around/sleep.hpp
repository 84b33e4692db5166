// Sleep of nodes at rest (server/physics/METHODS.md). A node rests while its contact is open. A sticking node rests,
// too, if it produces no friction heat and its layer certainly does not flow. After some steps at rest the temperatures
// of the node are replaced, in place, by the amplitudes of the eigenmodes of heat conduction; a step then multiplies
// each mode that has not decayed by a factor. The first step that would bring heat or might bring flow restores the
// temperatures and is solved. Sleep and waking of a lane depend on its own state and inputs alone.
#pragma once

#include "server/physics/solver/around/ledger.hpp"
#include "server/physics/solver/solvers.hpp"

namespace shearbus::physics {

// Number of steps at rest before a node sleeps. Solving that many steps costs about as much as transforming the
// temperatures to amplitudes and back.
int steps_before_sleep(int num_heat_vertices);

// Whether a lane is asleep: its rows of temperatures then hold amplitudes of modes.
inline bool asleep(const TileLayout& layout, const double* tile, int lane) {
  return layout.resting != TileLayout::kAbsent && tile[layout.resting + kLanes + lane] != 0.0;
}

// Interface temperature T0 of a lane, asleep or not  [K].
double interface_temperature(const Problem& problem, const double* tile, int lane);

// Growth of the heat in the two bodies of each lane (node) over a step, whether the lane sleeps or not. `entered`:
// friction heat of the step, [lane]  [J/m2].
StoredHeat stored_heat(const Problem& problem, const double* committed, const double* trial, const double* entered);

// Writes the temperatures of a lane, asleep or not, to `temperature`, [vertex][lane].
void profile_of(const Problem& problem, const double* tile, int lane, double* temperature);

// One step of the active lanes, by `solve` if they are awake and by `at_rest` if they sleep; the caller fills the other
// lanes of `trial`.
void advance_with_sleep(const Problem& problem, const StepOperators& operators, AdvanceTile solve, StepAtRest* at_rest,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
