// Junctions (MODEL.md, "Junctions"): the bodies touch on a fraction f of the area, through junctions of height d that
// harden with the slip, DLP (49-54) corrected:
//   dep_a/dt = |[v]| / (sqrt(3) d),   Tresca: s <= f Y_a / sqrt(3),   Y_a = min(Y_max_a, Y0_a (1 + beta_a ep_a)^n_a) g
#pragma once

#include <optional>
#include <span>

#include "server/physics/interface/state_variable.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

struct JunctionOptions {
  double contact_fraction = 1.0;  // fraction f of the area in contact
  double height = 0.0;            // height d of the junctions  [m]
  Material metal;                 // metal of the junctions, for its hardening: Y0_a, Y_max_a, beta_a, n_a
};

// The junctions of one node in one step; their strain is a state of the node.
struct Junctions {
  static constexpr StateVariable kStates[] = {{"junction_strain", "1"}};  // plastic strain of the junctions, ep_a

  const JunctionOptions* options = nullptr;  // null: no junctions, the bodies touch everywhere
  double strain_old = 0.0;                   // plastic strain ep_a before the step
  double strain_per_slip = 0.0;              // strain of the junctions per slip velocity, dt / (sqrt(3) d)  [s/m]

  double strain(double slip) const { return strain_old + strain_per_slip * slip; }

  // Shear strength of the junctions per area of the interface, without the softening g, after a step with the slip
  // velocity `slip`.
  struct Value {
    double strength;  // f Y_a / (g sqrt(3)): shear strength without the softening g  [Pa]
    double slope;     // derivative of the strength by the slip velocity  [Pa s/m]
  };
  Value at(double slip) const {
    const Material& m = options->metal;
    const double hardened = SteinbergCochranGuinan::hardened(m, strain(slip), 0.0, 0.0, 0.0);
    const double strength = options->contact_fraction * hardened / kSqrt3;
    const double rate = m.hardening_exponent * m.hardening_coefficient * strain_per_slip /
                        (1.0 + m.hardening_coefficient * strain(slip));
    return {strength, hardened < m.yield_strength_max ? strength * rate : 0.0};
  }
};

inline std::span<const StateVariable> states_of(const std::optional<JunctionOptions>& options) {
  return options ? std::span(Junctions::kStates) : std::span<const StateVariable>{};
}

inline Junctions junctions_of(const JunctionOptions* options, double strain_old, double dt) {
  if (options == nullptr) return {};
  return {options, strain_old, dt / (kSqrt3 * options->height)};
}

}  // namespace shearbus::physics
