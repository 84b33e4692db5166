// One step of a tile, as a chain of four links of which each calls the next:
//
//   frame of the interface > tolerance > sleep > the solver of the strategy
//
// Only pipeline.cpp asks which links a model has and which solver it uses.
#pragma once

#include "server/physics/solver/solvers.hpp"

namespace shearbus::physics {

// Takes the step of some lanes in memory of its own, since `solve` writes whole rows of a tile.
void advance_aside(AdvanceTile solve, const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                   std::uint32_t lanes, const double* committed, double* trial, TileOutputs& outputs);

// Fills in a lane without an answer: the outcome kFailed and the old state.
void keep_lane(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial, int lane,
               TileOutputs& outputs);

}  // namespace shearbus::physics
