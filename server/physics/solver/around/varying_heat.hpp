// Steps of bodies whose conductivity or heat capacity follows the temperature (MODEL.md, "k(T) and c(T)"). A step is
// linear in the heat that enters it, with coefficients of the node; each node therefore is a step of its own, with heat
// operators of its own, which is repeated with coefficients between the temperatures at both of its ends.
#pragma once

#include "server/physics/solver/pipeline.hpp"

namespace shearbus::physics {

// The vertices as they are in a step between two temperatures, [vertex][lane]: conduction lengths and weights are those of
// bodies of constant k and c that conduct and hold as much. `T_old` and `T_new` are the columns of a lane.
HeatGrid grid_between(const Problem& problem, const double* T_old, const double* T_new);

// One step of the active lanes by `solve`.
void advance_varying(const Problem& problem, double dt, AdvanceTile solve, const TileInputs& inputs,
                     const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
