// Estimates what a substep of a step under a tolerance adds to the errors of the step (METHODS.md, "Error of a
// substep").
#pragma once

#include <cstdint>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// The answer of one lane of a substep: the members of TileOutputs that the sum over substeps needs.
struct SubstepAnswer {
  double stress = 0.0, slip = 0.0, T0 = 0.0, jump_new = 0.0, heat = 0.0;
  double mean = 0.0;  // mean stress  [Pa]
  Regime regime = Regime::kOpen;
  std::uint8_t outcome = 0;
};

// What a force-driven jump beside a layer that may flow is: the flow of the layer alone, or slip as well, under friction or
// under the yield strength of the interface.
enum class Sharing : std::uint8_t { kUnknown, kFlow, kFriction, kYield };

// A substep of one lane.
struct Substep {
  int lane;
  double length;         // fraction of the host's step
  double of_rest;        // its length relative to the rest of the host's step
  double velocity_jump;  // jump before the substep  [m/s]
  double stress_before;  // stress before the substep  [Pa]
  double T0_before;      // interface temperature before the substep  [K]
  bool flowed;           // the layer flowed along the jump in the substep before, under the same pressure and jump
  double flux_before;    // heat flux that leaves z = 0 before the substep; of a step of both orders  [W/m2]
  // Stress at which the flow of the layer begins; 0: none is known. Of a force-driven substep that flows_on()  [Pa]
  double yield_before = 0.0;
  Sharing before = Sharing::kUnknown;
};

// The errors of the substeps of one tile. Each estimate is the largest of three errors, each as a fraction of its
// scale: of T0 at the end of the host's step, in T_melt - T_start; and of the heat and of the impulse of a
// velocity-driven step, in those that the largest stress would make of the step: the stress at either end of the
// substep, at least the strength of the cold, unstrained layer under the pressure of the step. The heat counts for no
// less than what would warm z = 0 by 0.03 (T_melt - T_start).
class SubstepErrors {
 public:
  // `response`: T0 per unit flux over the whole step  [K m2/W].
  SubstepErrors(const Problem& problem, const TileInputs& inputs, double dt, double response);

  // Of a velocity-driven substep of backward Euler alone: what the change of stress and T0 allows.
  double of_first_order(const Substep& substep, const SubstepAnswer& answer) const;

  // Of a velocity-driven substep of second order in one piece, from the same substep by backward Euler.
  double of_piece(const Substep& substep, const SubstepAnswer& answer, const SubstepAnswer& first_order) const;

  // Of the two halves of a substep, from the substep in one piece.
  double of_halves(const Substep& substep, const SubstepAnswer& piece, const SubstepAnswer (&halves)[2]) const;

  // The mean stress of two halves of a velocity-driven substep. Where the layer goes on flowing to second order it is
  // extrapolated from that of one piece and of the halves, whose straight paths cut off the bend of the stress.
  double mean_stress(const Substep& substep, const SubstepAnswer& piece, const SubstepAnswer (&halves)[2]) const;

  // Whether a force-driven layer flows along one direction, with no slip beside it, under a stress that follows from its
  // strain and temperature alone.
  bool flows_on(const Substep& substep, const SubstepAnswer& piece, const SubstepAnswer (&halves)[2]) const;

  // What is left of the mean stress of two halves of a force-driven substep of backward Euler, whose errors have one sign
  // in every substep and add up: their distance from one piece, as long as the interface goes on slipping in one
  // direction; that from Simpson's rule of a layer that flows_on(); else 0. The mean stress with it is at most
  // the friction  [Pa]. jump_after(): the jump after the substep with that mean stress.
  double impulse_left(const Substep& substep, const SubstepAnswer& piece, const SubstepAnswer (&halves)[2]) const;
  double jump_after(const Substep& substep, double jump_new, double impulse) const;

 private:
  struct Errors {
    double T0 = 0.0;    // [K]
    double heat = 0.0;  // [J/m2]
    double mean = 0.0;  // of the mean stress of the host's step  [Pa]
  };
  double largest(const Substep& substep, double stress, const Errors& errors) const;
  double most_friction(const Substep& substep, const SubstepAnswer (&halves)[2]) const;
  bool goes_on(const Substep& substep, const SubstepAnswer& piece, const SubstepAnswer (&halves)[2]) const;
  double heating(const Substep& substep) const;
  double takeover(const Substep& substep, const SubstepAnswer (&halves)[2]) const;
  double corner_of_flux(const Substep& substep, const SubstepAnswer& first, const SubstepAnswer& last) const;
  double elastic_path(const Substep& substep, const SubstepAnswer* parts, int num_parts) const;
  double jump_as_temperature(const Substep& substep, const SubstepAnswer& piece,
                             const SubstepAnswer (&halves)[2]) const;

  const Problem& problem_;
  const TileInputs& inputs_;
  const double dt_, response_;
  double range_;                  // T_melt - T_start  [K]
  double strength_[kLanes] = {};  // shear strength of the cold, unstrained layer  [Pa]
  bool forced_;
  bool stops_within_;  // a step knows where its jump stops or turns (force_driven/flowing_slip.hpp)
  bool sheared_;
};

}  // namespace shearbus::physics
