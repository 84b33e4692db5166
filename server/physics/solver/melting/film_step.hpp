// The force-driven step of an interface that may melt (MODEL.md, "Melt film"): DLP (61), (65), with latent heat and the
// resistance of the melt.
#pragma once

#include <array>
#include <optional>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// Steps the active lanes by backward Euler. The function overwrites inactive lanes of `trial` too; the caller restores
// them.
void advance_force_driven_melting(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs);

// The step of a lane at rest, all of which is solid and stays so; empty if heat or slip ends the rest. T0: interface
// temperature after the step, without friction  [K].
std::optional<RestingStep> melting_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                const TileInputs& inputs, const double* committed, const Material& soft,
                                                double T0, int lane);

// Adds the growth of the latent heat of the soft body over a step, [lane]  [J/m2].
void add_latent_heat(const Problem& problem, const double* committed, const double* trial,
                     std::array<double, kLanes>& stored);

// Thickness of the melt of one lane: the liquid of all its vertices  [m].
double film_thickness(const Problem& problem, const double* tile, int lane);

}  // namespace shearbus::physics
