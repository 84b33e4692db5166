#include "server/physics/solver/force_driven/travel.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/solver/flow/root_search.hpp"

namespace shearbus::physics {

Travel::Travel(const Forcing& forcing, const TrialSlip& trial, double dt)
    : direction_(trial.direction),
      before_(trial.jump_old),
      push_(trial.direction * (dt * forcing.acceleration)),
      per_stress_(trial.per_stress) {}

// Times are fractions of the step.
Travel::Path Travel::under(double stress) const {
  const double along = before_ != 0.0 ? before_ : push_;
  const double d = along < 0.0 ? -1.0 : 1.0, speed = d * before_, slows = per_stress_ * stress - d * push_;
  if (speed >= slows) {
    const double mean = speed - 0.5 * slows;
    return {mean, -0.5 * per_stress_, d * mean, d * (speed - slows), false};
  }
  const double stop = speed / slows, rest = 1.0 - stop, stops_sooner = stop * per_stress_ / slows;
  const double until_stop = 0.5 * speed * stop;
  const double turns = std::max(0.0, std::abs(push_) - per_stress_ * stress);  // against d, since it stops
  const double after = 0.5 * turns * (rest * rest);
  double by_stress = -0.5 * speed * stops_sooner;
  if (turns > 0.0) by_stress += rest * (turns * stops_sooner - 0.5 * per_stress_ * rest);
  return {until_stop + after, by_stress, d * (until_stop - after), -d * (turns * rest), speed > 0.0};
}

double Travel::rest_stress() const {
  return before_ != 0.0 ? std::numeric_limits<double>::infinity() : std::abs(push_) / per_stress_;
}

// The slip gives the stress, which falls with it, and the stress the slip.
LaneStep Travel::slip_next_to_rigid(const StressLimit& limit, double heat_partition, double B0, double T_ad,
                                    double guess) const {
  const auto heating = [&](double v) { return FrictionHeating{T_ad, heat_partition * B0, v, 0.0}; };
  const auto stress_at = [&](double v) {
    const StressLimit at_slip = limit.at_slip(v);
    const double cold = at_slip.at(T_ad).stress;
    return cold > 0.0 ? slip_stress(at_slip, heating(v), cold, guess) : 0.0;
  };
  const auto open = [&](double v) { return v - under(stress_at(v)).mean; };
  double v = under(0.0).mean;
  if (const double at_most = open(v); at_most > 0.0) v = zero_between(0.0, open(0.0), v, at_most, v, -1.0, open);
  const double a = below_melting(limit, heating(v), heat_partition, B0, stress_at(v));
  const double flux = heat_partition * (a * v);
  return {direction_ * a, direction_ * v, 0.0, flux, slip_regime(limit, T_ad + flux * B0, v), false, true, false};
}

LaneStep Travel::answer(LaneStep moving) const {
  const double stress = std::abs(moving.stress);
  const Path path = under(stress);
  if (path.mean > 0.0) moving.slip *= path.net / path.mean;
  moving.jump_new = direction_ * path.end;
  // The difference has the rounding of the velocities, which may be that of many times the stress.
  if (path.end == 0.0 || path.stops)
    moving.stress = direction_ * std::clamp((before_ + push_ - path.end) / per_stress_, -stress, stress);
  if (path.end == 0.0) {
    moving.sticks = true;
    moving.regime = Regime::kStick;
  }
  return moving;
}

}  // namespace shearbus::physics
