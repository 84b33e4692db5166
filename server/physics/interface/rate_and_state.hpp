// Rate-and-state friction (Dieterich 1979; Ruina 1983), regularised at rest (Rice, Lapusta, Ranjith 2001):
//
//   friction = P a asinh( v/(2 V0) exp((mu + b zeta)/a) ),   zeta = ln(V0 theta/D)
//   ageing:  dtheta/dt = 1 - v theta/D          slip:  dtheta/dt = -(v theta/D) ln(v theta/D)
//
// The state is zeta: 0 is steady sliding at V0, with which a node starts and with which a contact closes again. The step
// is exact at a constant slip. Its friction rises with v (a) and falls with v through theta (b), except that under the
// slip law slip heals a contact that is fresher than steady (v theta < D).
#pragma once

#include <algorithm>
#include <cmath>

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/state_variable.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {

struct RateAndState {
  static constexpr std::string_view kName = "rate_and_state";
  static constexpr std::string_view kEquation = "Dieterich 1979; Ruina 1983";
  static constexpr std::string_view kAdds = "friction that follows the slip velocity and heals, over a slip length";
  static constexpr std::string_view kWhen = "stick-slip, healing of contacts at rest, faults";
  static constexpr bool kRisesWithSlip = true;
  static constexpr bool kFallsWithSlip = true;
  static constexpr bool kDependsOnTemperature = false;
  static constexpr StateVariable kStates[] = {{"friction_state", "1"}};

  static InterfaceOptions typical(InterfaceOptions options, const Material& /*soft*/) {
    options.slip_length = 1e-6;
    options.reference_velocity = 1.0;
    options.direct_effect = 0.02 * options.friction_coefficient;
    options.evolution_effect = 0.03 * options.friction_coefficient;
    return options;
  }
  static LawFault fault_of(const InterfaceOptions& options, const Material& /*soft*/) {
    if (!(options.slip_length > 0.0)) return {"slip_length_m", "it must be above 0"};
    if (!(options.reference_velocity > 0.0)) return {"reference_velocity_m_per_s", "it must be above 0"};
    if (!(options.direct_effect > 0.0))
      return {"direct_effect", "it must be above 0: without it nothing resists a sudden slip"};
    if (!(options.evolution_effect >= 0.0)) return {"evolution_effect", "it must not be negative"};
    return {};
  }

  static FrictionValue at(const InterfaceOptions& options, const Material& /*soft*/, const ContactPoint& point) {
    if (!(point.slip.up >= kLeastVelocity)) return {0.0};
    const State state = after(options, point);
    const double a = options.direct_effect, b = options.evolution_effect;
    const double x = logarithm(0.5 * point.slip.up / options.reference_velocity) +
                     (options.friction_coefficient + b * state.zeta) / a;
    // asinh(exp(x)) and its derivative by x, which is 1 where asinh is a logarithm
    const double e = exponential(std::min(x, kLogarithmic));
    const double root = std::sqrt(1.0 + e * e);
    const double arc = x < kLogarithmic ? log_of_1_plus(e + e * e / (1.0 + root)) : x + kLn2;
    const double scale = point.pressure * (x < kLogarithmic ? e / root : 1.0);
    return {point.pressure * a * arc, 0.0, scale * (a / point.slip.up + b * state.by_up), scale * b * state.by_down};
  }
  static void advance(const InterfaceOptions& options, const ContactPoint& point, double* state) {
    *state = point.pressure > 0.0 ? after(options, point).zeta : 0.0;
  }

 private:
  static constexpr double kLeastVelocity =
      1e-290;                                   // a slower slip counts as none: logarithms take normal numbers  [m/s]
  static constexpr double kLogarithmic = 20.0;  // from this x on asinh(exp(x)) is x + ln(2) to rounding
  static constexpr double kLn2 = 0.6931471805599453;

  struct State {
    double zeta, by_up, by_down;  // the state after the step, and its derivatives by either slip  [s/m]
  };
  static State after(const InterfaceOptions& options, const ContactPoint& point) {
    return options.state_evolution == StateEvolution::kSlip ? after_by_slip(options, point)
                                                            : after_by_age(options, point);
  }

  // theta = theta_old exp(-x) + dt (1 - exp(-x))/x, x = v dt/D, falls with v.
  static State after_by_age(const InterfaceOptions& options, const ContactPoint& point) {
    constexpr double kSmall = 1e-3;
    const double per_velocity = point.dt / options.slip_length, grown = options.reference_velocity * per_velocity;
    const double x = point.slip.down * per_velocity, kept = exponential(-x);
    const double mean = x < kSmall ? 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0)) : (1.0 - kept) / x;
    const double mean_slope = x < kSmall ? -0.5 * (1.0 - x * (2.0 / 3.0) * (1.0 - x * (3.0 / 8.0))) : (kept - mean) / x;
    const double old = exponential(*point.state), age = old * kept + grown * mean;
    return {logarithm(age), 0.0, std::min(0.0, per_velocity * (grown * mean_slope - old * kept) / age)};
  }

  // zeta = zeta_old - w u, u = ln(v theta_old/D), w = 1 - exp(-v dt/D). Where u < 0 slip heals.
  static State after_by_slip(const InterfaceOptions& options, const ContactPoint& point) {
    const double per_velocity = point.dt / options.slip_length, up = point.slip.up;
    const double down = std::max(point.slip.down, kLeastVelocity);
    const double u = *point.state + logarithm(down / options.reference_velocity);
    const double velocity = u < 0.0 ? up : down, lost = -exponential_minus_1(-velocity * per_velocity);
    const double lost_slope = per_velocity * (1.0 - lost);
    return {*point.state - lost * u, u < 0.0 ? -lost_slope * u : 0.0,
            u < 0.0 ? -lost / down : -lost_slope * u - lost / down};
  }
};

}  // namespace shearbus::physics
