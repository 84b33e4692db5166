// Friction that falls with velocity, DLP (3), (5):
//
//   mu(v) = mu_inf + (mu_0 - mu_inf) exp(-theta v)
//
// In a step whose slip under the stress a is c - b a there is one answer if b theta (mu_0 - mu_inf) P exp(-theta v) < 1
// at every slip v. Friction that rises with velocity, mu_inf > mu_0, always has one.
#pragma once

#include <algorithm>

#include "server/physics/interface/friction.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {

struct VelocityWeakening {
  static constexpr std::string_view kName = "velocity_weakening";
  static constexpr std::string_view kEquation = "DLP (3), (5)";
  static constexpr std::string_view kAdds = "friction that falls with the sliding velocity";
  static constexpr std::string_view kWhen = "dry friction below the yield limit";
  static constexpr bool kRisesWithSlip = true;
  static constexpr bool kFallsWithSlip = true;
  static constexpr bool kDependsOnTemperature = false;

  static InterfaceOptions typical(InterfaceOptions options, const Material& /*soft*/) {
    options.friction_coefficient_fast = 0.1 * options.friction_coefficient;
    options.velocity_decay = 0.01;
    return options;
  }
  static LawFault fault_of(const InterfaceOptions& /*options*/, const Material& /*soft*/) { return {}; }
  static FrictionValue at(const InterfaceOptions& options, const Material& /*soft*/, const ContactPoint& point) {
    const double drop = options.friction_coefficient - options.friction_coefficient_fast;
    const double velocity = drop < 0.0 ? point.slip.up : point.slip.down;
    const double varying = drop * exponential(-options.velocity_decay * velocity);
    const double slope = -options.velocity_decay * varying * point.pressure;
    return {(options.friction_coefficient_fast + varying) * point.pressure, 0.0, std::max(0.0, slope),
            std::min(0.0, slope)};
  }
  static FrictionForm form(const InterfaceOptions& options) {
    return FallsWithSlip{options.friction_coefficient, options.friction_coefficient_fast, options.velocity_decay};
  }
};

}  // namespace shearbus::physics
