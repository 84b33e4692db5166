// Friction that remembers the pressure: after a change of P it follows over a slip length L only, as in pressure-shear
// plate impact (Prakash, Clifton 1993), in the regularised form of Rubin and Ampuero (2007):
//
//   friction = mu psi,   dpsi/dt = -(|[v]| + V*)/L (psi - P)
//
// The state is psi, the pressure that the friction knows. A contact that closes knows none (psi = 0), so its friction
// grows from 0; one that opens forgets. The step is exact at a constant slip and pressure.
#pragma once

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/state_variable.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {

struct PrakashClifton {
  static constexpr std::string_view kName = "prakash_clifton";
  static constexpr std::string_view kEquation = "Prakash, Clifton 1993; Rubin, Ampuero 2007";
  static constexpr std::string_view kAdds = "friction that follows a change of pressure over a slip length";
  static constexpr std::string_view kWhen = "pressure that changes within micrometres of slip: impact, waves";
  static constexpr bool kRisesWithSlip = true;
  static constexpr bool kFallsWithSlip = true;
  static constexpr bool kDependsOnTemperature = false;
  static constexpr StateVariable kStates[] = {{"remembered_pressure_pa", "Pa"}};

  static InterfaceOptions typical(InterfaceOptions options, const Material& /*soft*/) {
    options.slip_length = 1e-6;
    options.reference_velocity = 1.0;
    return options;
  }
  static LawFault fault_of(const InterfaceOptions& options, const Material& /*soft*/) {
    if (!(options.slip_length > 0.0)) return {"slip_length_m", "it must be above 0"};
    return {};
  }
  static FrictionValue at(const InterfaceOptions& options, const Material& /*soft*/, const ContactPoint& point) {
    const double off = *point.state - point.pressure;  // what is remembered of another pressure
    const double kept = off * kept_of(options, off > 0.0 ? point.slip.down : point.slip.up, point.dt);
    const double slope = -options.friction_coefficient * kept * point.dt / options.slip_length;
    return {options.friction_coefficient * (point.pressure + kept), 0.0, off > 0.0 ? 0.0 : slope,
            off > 0.0 ? slope : 0.0};
  }
  static void advance(const InterfaceOptions& options, const ContactPoint& point, double* state) {
    const double off = *point.state - point.pressure;
    *state = point.pressure > 0.0 ? point.pressure + off * kept_of(options, point.slip.up, point.dt) : 0.0;
  }

 private:
  static double kept_of(const InterfaceOptions& options, double slip, double dt) {
    return exponential(-(slip + options.reference_velocity) * dt / options.slip_length);
  }
};

}  // namespace shearbus::physics
