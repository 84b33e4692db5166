// The solvers. A model has one, which pipeline.cpp chooses.
#pragma once

#include <optional>
#include <type_traits>

#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// A step of the active lanes from `committed` to `trial`, with their `outputs`. A solver may overwrite the other lanes
// of `trial`, too; the caller restores them.
using AdvanceTile = void (*)(const Problem&, const StepOperators&, const TileInputs&, const double* committed,
                             double* trial, TileOutputs& outputs);
using StepOfTile = std::remove_pointer_t<AdvanceTile>;

// The step of one lane (node) that sleeps (METHODS.md, sleep), with the same bits that the solver would find from the
// same T0, or nothing if the lane must wake: because it slips, is heated, or may have several answers. The caller
// checks that no vertex yields under the stress. `soft`: the soft material at the pressure of the lane. T0: interface
// temperature after the step, without friction  [K].
using StepAtRest = std::optional<LaneResult>(const Problem&, const StepOperators&, const TileInputs&,
                                             const double* committed, const Material& soft, double T0, int lane);

// The velocity-driven step (MODEL.md, "Velocity-driven step"): DLP (37), (42-48), (56). The host imposes the velocity
// jump; the stress follows from the plastic flow of the layer. DLP (56) omits the velocity that shears the layer.
// To second order (METHODS.md) the second stage extrapolates temperatures from the first. A lane in which one of them
// falls below the coldest old temperature or reaches melting takes a backward Euler step instead and reports
// kFirstOrder.
StepOfTile advance_velocity_driven, advance_velocity_driven_sdirk2;
StepAtRest velocity_driven_step_at_rest;

// The step of layers with inertia (MODEL.md, "Layer inertia"): DLP (36) is solved together with heat and plastic flow.
// Velocity-driven the host imposes the velocity jump at z = h, the hard body is at rest at z = 0, the stress follows
// from waves and plastic flow.
// To second order: SDIRK2 for waves, plastic flow and heat together, two stages of the step of first order. A lane
// whose second stage starts from temperatures out of range, or has no answer, takes the step of first order instead and
// reports kFirstOrder.
StepOfTile advance_with_inertia, advance_with_inertia_sdirk2;

// The force-driven step without flow of the layer (MODEL.md, "Force-driven step"): DLP (61), (65). The host sends
// far-field stresses, the interface law finds the slip. The only plastic strain is that of junctions (MODEL.md,
// "Junctions"). By backward Euler or, in a scene with heat = "modes", by the exact decay of the modes of heat
// conduction. A step that may have several answers is divided into substeps.
// To second order (METHODS.md) a lane to which SDIRK2 does not apply, for instance because its slip stops or reverses,
// takes a backward Euler step; its outcome then includes kFirstOrder, unless it sticks at the end.
StepOfTile advance_force_driven, advance_force_driven_sdirk2;
StepAtRest force_driven_step_at_rest;

// The force-driven step with plastic strain (MODEL.md, "Plastic layer"): DLP (48), (61), (64) and the interface law
// together.
StepOfTile advance_force_driven_flowing;

// The force-driven step of an interface that may melt (MODEL.md, "Melt film"): DLP (61), (65), with latent heat and the
// resistance of the melt, by backward Euler. At rest all is solid and stays so.
StepOfTile advance_force_driven_melting;
StepAtRest melting_step_at_rest;

}  // namespace shearbus::physics
