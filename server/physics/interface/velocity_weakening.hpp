// Friction that falls with velocity, DLP (3), (5):
//
//   mu(v) = mu_inf + (mu_0 - mu_inf) exp(-theta v)
//
// In a step whose slip under the stress a is c - b a the balance h(a) = mu(c - b a) P - a is convex where friction
// falls with velocity. While the interface slips h has two zeros at most; it has no more than one if
// b theta (mu_0 - mu_inf) P exp(-theta v) < 1 at every slip v.
#pragma once

#include <string_view>

#include "server/physics/interface/friction.hpp"

namespace shearbus::physics {

struct VelocityWeakening {
  static constexpr std::string_view kName = "velocity_weakening";
  static constexpr std::string_view kEquation = "DLP (3), (5)";
  static constexpr std::string_view kAdds = "friction that falls with the sliding velocity";
  static constexpr std::string_view kWhen = "dry friction below the yield limit";
  static constexpr bool kDependsOnSlip = true;
  static constexpr bool kDependsOnTemperature = false;

  double at_rest;  // coefficient without slip, mu_0
  double fast;     // coefficient at high velocity, mu_inf
  double decay;    // decay with velocity, theta  [s/m]

  double coefficient(double velocity) const;

  static VelocityWeakening of(const InterfaceOptions& options) {
    return {options.friction_coefficient, options.friction_coefficient_fast, options.velocity_decay};
  }
  static InterfaceOptions typical(const InterfaceOptions& options, const Material& soft);
  static LawFault fault_of(const InterfaceOptions& /*options*/, const Material& /*soft*/) { return {}; }
  static FrictionValue at(const InterfaceOptions& options, const Material& soft, double T0, double slip);
  static FrictionForm form(const InterfaceOptions& options) {
    return FallsWithSlip{options.friction_coefficient, options.friction_coefficient_fast, options.velocity_decay};
  }
  static SlidingFriction of_step(const InterfaceOptions& options, double pressure, double c, double b, double a_stick);
};

// The smallest a >= 0 with a = mu(max(0, c - b a)) P  [Pa]. A solution always exists. Where friction falls steeply with
// velocity there may be three solutions; a sliding node then continues in the smallest.
double sliding_stress(const VelocityWeakening& law, double pressure, double c, double b);

}  // namespace shearbus::physics
