// One stage of the step of layers with inertia (inertia.hpp): backward Euler for waves, plastic flow, heat and contact
// together, MODEL.md, "Layer inertia".
#pragma once

#include <cstdint>
#include <optional>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

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

// The contacts of a tile whose limit is more than one friction stress: a contact law, or junctions.
class WaveContacts {
 public:
  struct Lane {
    StressLimit limit;
    ContactState state;
    bool stuck = false;  // the interface did not slip at the end of the last step
    double drive = 0.0;  // force-driven: slip velocity due to the host's plastic shear, signed, DLP (64)  [m/s]
  };
  // Of the active lanes, in a step of length dt from the state `committed`.
  WaveContacts(const Problem& problem, const TileInputs& inputs, const double* committed, double dt);
  WaveContacts(const WaveContacts&) = delete;
  WaveContacts& operator=(const WaveContacts&) = delete;

  static bool needed(const Problem& problem);

  Lane& operator[](int lane) { return lanes_[lane]; }
  const Lane& operator[](int lane) const { return lanes_[lane]; }

 private:
  LaneMaterials soft_at_;
  Lane lanes_[kLanes];
};

// The bodies at the ends of the layers of a tile in one stage.
struct WaveEnds {
  double jump[kLanes];                         // velocity at z = h, of a body that gives way before the stage  [m/s]
  double give_near[kLanes], give_far[kLanes];  // WaveStep
};

// Solves the waves of several lanes under given limits of the stress at z = 0 from the state in `trial`. `guess`: as in
// solve_stage(). Returns the lanes that have no answer.
std::uint32_t solve_waves(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                          const WaveEnds& ends, std::uint32_t lanes, const double (&limit)[kLanes], const double* guess,
                          double* trial, Found (&found)[kLanes]);

// Backward Euler of `lanes` over the length of `heat`, from the state in `trial`, whose temperatures have been conducted
// already. `contacts`: null where a constant friction stress limits the stress, or none. `guess`: rows of velocities
// from which the search starts; null: those before the step. Returns the lanes that have no answer.
std::uint32_t solve_stage(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                          std::uint32_t lanes, const WaveContacts* contacts, double* trial, Found (&found)[kLanes],
                          const double* guess = nullptr);

}  // namespace shearbus::physics
