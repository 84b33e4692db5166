// The contact at z = 0 of layers with inertia (MODEL.md, "Layer inertia"): a contact law or junctions next to waves.
#pragma once

#include <cstdint>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

namespace shearbus::physics {

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

// As solve_waves(), with the stress and slip of the contacts.
std::uint32_t solve_contacts(const InertiaStage& stage, const WaveEnds& ends, std::uint32_t lanes);

}  // namespace shearbus::physics
