// One stage of the step of layers with inertia (inertia.cpp): backward Euler for waves, plastic flow, heat and contact
// together, MODEL.md, "Layer inertia".
#pragma once

#include <cstdint>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// A stress at z = 0 below this one, which only a layer that melts there has, is no stress: rounding decides its sign.
inline constexpr double kNoStress = 1.0;  // [Pa]

// What a stage, or a step of two stages, has found in one lane.
struct Found {
  double flux = 0.0;             // heat flux q into the layer: of a step its mean  [W/m2]
  double slip_along[2] = {};     // flow and slip at z = 0 along stresses above 0, and along stresses below 0  [m]
  double interface_slip = 0.0;   // slip velocity of the interface at the end, without the flow of the layer  [m/s]
  double mean_slip = 0.0;        // the same; of a step its mean
  bool interface_slips = false;  // at the end the limit of the contact holds the stress at z = 0
  bool several = false;          // the interface could stick as well
  double stress[2] = {};         // stress at z = 0 and at z = h; of a step the means in its balance of momentum  [Pa]
};

class WaveContacts;

// The bodies at the ends of the layers of a tile in one stage.
struct WaveEnds {
  double jump[kLanes];                         // velocity at z = h, of a body that gives way before the stage  [m/s]
  double give_near[kLanes], give_far[kLanes];  // WaveStep
};

// One stage: backward Euler over the length of `heat`, from the state in `trial`, whose temperatures have been conducted
// already.
struct InertiaStage {
  const Problem& problem;
  const HeatOperator& heat;
  const TileInputs& inputs;
  const WaveContacts* contacts;  // null where a constant friction stress limits the stress, or none
  double* trial;
  Found (&found)[kLanes];
  const double* guess = nullptr;  // rows of velocities from which the search starts; null: those before the stage
};

// Solves `lanes` and returns those that have no answer.
std::uint32_t solve_stage(const InertiaStage& stage, std::uint32_t lanes);

// The same between given bodies, under given limits of the stress at z = 0.
std::uint32_t solve_waves(const InertiaStage& stage, const WaveEnds& ends, std::uint32_t lanes,
                          const double (&limit)[kLanes]);

// Share of the work at z = 0 that waves (of the stress on the jump) or contacts (of the slip) turn into heat there. Where
// plastic work heats in place, the temperatures that a stage is given hold all its heat (waves_heat.hpp).
inline double heat_share(const Problem& problem) {
  return problem.options.taylor_quinney_factor ? 0.0 : problem.heat_partition;
}
inline bool is_forced(const Problem& problem) {
  return problem.options.strategy == Strategy::kForceDriven;
}

}  // namespace shearbus::physics
