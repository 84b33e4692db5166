#include "server/physics/interface/own.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace shearbus::physics {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kUnknown = std::numeric_limits<double>::infinity();
constexpr double kShare = 1e-5;      // step of the difference quotients, relative to temperature and slip
constexpr double kLeastSlip = 1e-9;  // least scale of the slip in them  [m/s]
constexpr double kDigits = 1e-9;     // rounding of a law, relative to its value

// The limit with one slip velocity for the friction itself and another for the states.
struct Asked {
  const InterfaceOptions& options;
  double melting_temperature;
  const ContactPoint& point;

  double limit(double T, double direct, double through_states) const {
    const shearbus_friction_law& law = *options.own;
    if (law.falls_with_temperature != 0 && T >= melting_temperature) return 0.0;
    double state[kMostFrictionStates];
    std::copy_n(point.state, kMostFrictionStates, state);
    shearbus_contact_point at{options.friction_coefficient, point.pressure, T, kUnknown, through_states, point.state};
    try {
      if (law.num_states > 0) law.advance(&at, point.dt, state);
      at.slip = direct;
      at.melting_temperature = melting_temperature;
      at.state = state;
      const double stress = law.limit(&at);
      return std::isfinite(stress) && stress >= 0.0 ? stress : kNone;
    } catch (...) {
      return kNone;
    }
  }
};

// The derivative of a law that declares to rise (1), fall (-1) or stay (0) from `less` to `more`, `width` apart; NaN if it
// does otherwise.
double slope_of(int declared, double less, double more, double width) {
  const double change = more - less, digits = kDigits * (more + less);
  const bool kept = declared > 0 ? change >= -digits : declared < 0 ? change <= digits : std::abs(change) <= digits;
  if (!kept) return kNone;
  return declared > 0 ? std::max(0.0, change / width) : declared < 0 ? std::min(0.0, change / width) : 0.0;
}

double half_of_coulomb(const shearbus_contact_point* point) {
  return 0.5 * point->friction_coefficient * point->pressure;
}
constexpr shearbus_friction_law kHalf{
    SHEARBUS_FRICTION_LAW_VERSION, 0, SHEARBUS_CONSTANT, SHEARBUS_CONSTANT, 0, half_of_coulomb, nullptr};

}  // namespace

InterfaceOptions Own::typical(InterfaceOptions options, const Material& /*soft*/) {
  options.own = &kHalf;
  return options;
}

FrictionValue Own::at(const InterfaceOptions& options, const Material& soft, const ContactPoint& point) {
  const shearbus_friction_law& law = *options.own;
  const Asked asked{options, soft.melting_temperature, point};
  const double T = point.temperature;
  const bool rises = law.with_slip > 0, states_rise = law.through_states > 0;
  const double direct = rises ? point.slip.up : point.slip.down;
  const double by_states = states_rise ? point.slip.up : point.slip.down;
  FrictionValue value{asked.limit(T, direct, by_states)};
  const double step_T = kShare * std::max(1.0, T);
  value.slope = slope_of(law.falls_with_temperature != 0 ? -1 : 0, asked.limit(T - step_T, direct, by_states),
                         asked.limit(T + step_T, direct, by_states), 2.0 * step_T);
  const auto about = [](double slip) {
    const double step = kShare * std::max(slip, kLeastSlip);
    return Slip{slip + step, std::max(0.0, slip - step)};
  };
  const Slip near = about(direct), near_states = about(by_states);
  const double slope = slope_of(law.with_slip, asked.limit(T, near.down, by_states), asked.limit(T, near.up, by_states),
                                near.up - near.down);
  const double states_slope = law.num_states == 0
                                  ? 0.0
                                  : slope_of(law.through_states, asked.limit(T, direct, near_states.down),
                                             asked.limit(T, direct, near_states.up), near_states.up - near_states.down);
  if (std::isnan(value.slope + slope + states_slope)) value.stress = kNone;
  value.up_slope = std::max(0.0, slope) + std::max(0.0, states_slope);
  value.down_slope = std::min(0.0, slope) + std::min(0.0, states_slope);
  return value;
}

void Own::advance(const InterfaceOptions& options, const ContactPoint& point, double* state) {
  const shearbus_friction_law& law = *options.own;
  if (law.num_states == 0) return;
  const shearbus_contact_point at{
      options.friction_coefficient, point.pressure, point.temperature, kUnknown, point.slip.up, point.state};
  try {
    law.advance(&at, point.dt, state);
  } catch (...) {
    std::fill_n(state, kMostFrictionStates, kNone);
  }
}

}  // namespace shearbus::physics
