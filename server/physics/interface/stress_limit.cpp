#include "server/physics/interface/stress_limit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/interface/bisection.hpp"
#include "server/physics/interface/edge_zero.hpp"

namespace shearbus::physics {
namespace {

constexpr int kMaxIterations = 200;    // largest number of iterations of slip_stress(); bisection alone needs 60
constexpr int kNewtonIterations = 12;  // more than Newton's method usually needs; later every second iteration bisects
// The search ends after a Newton step shorter than this fraction of the stress: the next step would be below rounding.
constexpr double kConverged = 1e-9;
constexpr double kLeastGuess = 1e-12;  // smallest starting stress used, relative to the upper end of the bracket

// The limit s_lim of the interface at the temperature and slip that the stress a causes, and its derivative
// d(s_lim)/da.
struct Carried {
  StressLimit::Value limit;
  double slope;
  double slip;
};
Carried carried(const StressLimit& limit, const FrictionHeating& heating, double a) {
  if (limit.effort != nullptr) ++limit.effort->limit_values;
  const double slip = heating.slip(a);
  const StressLimit::Value s = limit.at(heating.temperature(a), slip);
  if (slip <= 0.0) return {s, 0.0, 0.0};
  return {s, s.slope * (heating.rise * (heating.c - 2.0 * heating.b * a)) - s.slip_slope() * heating.b, slip};
}

// Whether a Newton step from the stress a is so short that the error after the step is below rounding. Where the limit
// depends on the slip the step must also be short relative to the slip: near the sticking stress a small
// change of the stress is a large change of the slip. A step of a few ulps is always short.
bool is_short(double step, double a, const Carried& s, double b) {
  constexpr double kUlps = 4.0 * std::numeric_limits<double>::epsilon();
  const double size = std::abs(step);
  return size <= kConverged * a &&
         (s.limit.slip_slope() == 0.0 || size * b <= kConverged * s.slip || size <= kUlps * a);
}

// An upper bound of the limit in a step: that of the unheated interface, at the slip without stress where it rises with
// slip, and at rest where it falls.
double most_carried(const StressLimit& limit, const FrictionHeating& heating) {
  return limit.at(heating.T_ad, {heating.slip(0.0), 0.0}).stress;
}

// Improves the root `a` of H(a) = s_lim - a by one Newton step, which removes the error that the tolerance of the
// search left. Returns `cold` if the interface would be molten at `a`.
double polished(const StressLimit& limit, const FrictionHeating& heating, double a, double a_max, double cold) {
  const Carried s = carried(limit, heating, a);
  if (s.limit.stress <= 0.0) return cold;
  const double step = -(s.limit.stress - a) / (s.slope - 1.0);
  const double better = a + step;
  return std::abs(step) < kConverged * a && better <= a_max ? better : a;
}

}  // namespace

StressLimit::Value StressLimit::varying_friction(double temperature, Slip slip) const {
  const bool held = held_slip != kFree;
  const bool up_is_least = slip.up < least_slip, down_is_least = slip.down < least_slip;
  if (up_is_least) slip.up = least_slip;
  if (down_is_least) slip.down = least_slip;
  const FrictionValue friction = FrictionLaws::with(varying->friction_law, [&](auto own) {
    return decltype(own)::type::at(*varying, *soft, {pressure, temperature, held ? held_slip : slip, dt, state.data()});
  });
  return {friction.stress * share, friction.slope * share, true, held || up_is_least ? 0.0 : friction.up_slope * share,
          held || down_is_least ? 0.0 : friction.down_slope * share};
}

FrictionStates StressLimit::states_after(double temperature, double slip) const {
  FrictionStates after = state;
  if (varying == nullptr) return after;
  FrictionLaws::with(varying->friction_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    if constexpr (FrictionWithState<Law>)
      Law::advance(*varying, {std::max(0.0, pressure), temperature, slip, dt, state.data()}, after.data());
  });
  return after;
}

bool StressLimit::falls_with_temperature() const {
  return FrictionLaws::with(varying->friction_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    if constexpr (requires { Law::vanishes_at_melting(*varying); }) return Law::vanishes_at_melting(*varying);
    return Law::kDependsOnTemperature;
  });
}

bool StressLimit::falls_with_slip() const {
  return varying != nullptr && properties_of(varying->friction_law).falls_with_slip;
}

StressLimit StressLimit::at_slip(double slip) const {
  StressLimit other = *this;
  if (junctions.options != nullptr) {
    other.tresca = junctions.at(slip).strength;
    other.junctions = {};
  }
  other.held_slip = std::max(slip, least_slip);
  return other;
}

double StressLimit::steepest(double coldest, double hottest, double most_slip) const {
  const double strength = junctions.options ? junctions.at(most_slip).strength : tresca;
  const double yield = strength * FlowLaws::with(soft->flow_law, [&](auto law) {
                         return decltype(law)::type::steepest_softening(*soft, pressure, coldest, hottest);
                       });
  if (varying == nullptr) return yield;
  const double rubbing =
      share * FrictionLaws::with(varying->friction_law, [&](auto own) {
        using Law = typename decltype(own)::type;
        if constexpr (Law::kDependsOnTemperature)
          return Law::steepest(*varying, *soft, {pressure, hottest, most_slip, dt, state.data()}, coldest, hottest);
        else
          return 0.0;
      });
  // Both branches of the limit, friction and yield, fall with T0. A branch below the other over the whole range is the
  // limit.
  const double yield_cold = strength * softening(*soft, pressure, coldest).g;
  const double yield_hot = strength * softening(*soft, pressure, hottest).g;
  if (friction(coldest, {most_slip, 0.0}).stress < yield_hot) return rubbing;
  if (yield_cold <= friction(hottest, {0.0, most_slip}).stress) return yield;
  return std::max(yield, rubbing);
}

double spare_strength(const StressLimit& limit, const FrictionHeating& heating, double a) {
  if (limit.effort != nullptr) ++limit.effort->limit_values;
  return limit.at(heating.temperature(a), heating.slip(a)).stress - a;
}

double slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max, double guess) {
  // The first upper bound of the stress is the limit before friction heats, at the slip without stress, which is the
  // largest slip.
  double hi = std::min(a_max, most_carried(limit, heating));
  double lo = 0.0;
  if (hi <= 0.0) return 0.0;
  if (spare_strength(limit, heating, hi) >= 0.0) return hi;
  // If the stress `melting` leaves at least half of the frictionless slip c, its heat melts the interface. Then
  // `melting` is an upper bound of the root, and with fast slip it is far below `hi`.
  const double melting = 2.0 * (limit.soft->melting_temperature - heating.T_ad) / (heating.rise * heating.c);
  if (melting < hi && 2.0 * heating.b * melting <= heating.c && limit.vanishes_at_melting()) hi = melting;
  double a = guess > kLeastGuess * hi && guess < hi ? guess : 0.5 * hi;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Carried s = carried(limit, heating, a);
    const double stress = s.limit.stress;
    if (std::isnan(stress)) return stress;  // a law gave no number
    (stress > a ? lo : hi) = a;
    if (stress == a || hi - lo <= 2.0 * std::numeric_limits<double>::epsilon() * hi) return a;
    // Newton works on log(s_lim / a), which is concave where melting makes s_lim fall like exp(-1/x), so that steps
    // from the hot side never overshoot.
    double next = 0.0;
    if (stress > 0.0 && a > 0.0) {
      next = a - logarithm(stress / a) / (s.slope / stress - 1.0 / a);
      if (is_short(next - a, a, s, heating.b)) {
        // Near melting the step on log(s_lim / a) may be short although a is far from the root. So the root is accepted
        // only if the Newton step on H(a) = s_lim - a is short, too.
        const double straight = a + (stress - a) / (1.0 - s.slope);
        if (is_short(straight - a, a, s, heating.b)) {
          return polished(limit, heating, std::clamp(next, lo, hi), a_max, std::clamp(straight, lo, hi));
        }
        next = straight;
      }
    }
    const bool bisect = iteration >= kNewtonIterations && iteration % 2 == 0;
    a = !bisect && next > lo && next < hi ? next : 0.5 * (lo + hi);
  }
  return std::numeric_limits<double>::quiet_NaN();  // no root was found
}

double below_melting(const StressLimit& limit, const FrictionHeating& heating, double partition, double B0, double a) {
  const double T_melt = limit.soft->melting_temperature;
  // Checks T0 as the step will store it and as FrictionHeating computes it: the two may differ in the last digit.
  const auto melts = [&](double stress) {
    return heating.T_ad + partition * (stress * heating.slip(stress)) * B0 >= T_melt ||
           heating.temperature(stress) >= T_melt;
  };
  if (heating.T_ad >= T_melt || !melts(a)) return a;
  return bisected(0.0, a, melts).lo;
}

bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max) {
  const double end = std::min(a_max, most_carried(limit, heating));
  if (2.0 * heating.b * end <= heating.c || heating.c <= 0.0) return true;  // heating rises with stress up to `end`
  const double hottest = heating.temperature(0.5 * heating.c / heating.b);
  // Above the stress of greatest heating the slip is at most c/2, half the slip without friction.
  if (limit.is_constant_below(hottest, heating.slip(end))) return true;
  const double coldest = heating.temperature(end);
  return heating.rise * limit.steepest(coldest, hottest, 0.5 * heating.c) * (2.0 * heating.b * end - heating.c) < 1.0;
}

SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max) {
  const auto point = [&](double a) { return SlipPoint{a, heating.temperature(a), heating.slip(a)}; };
  const double end = std::min(a_max, most_carried(limit, heating));
  const double peak = heating.b > 0.0 && heating.c > 0.0 ? std::min(end, 0.5 * heating.c / heating.b) : end;
  const auto zero_from = [&](double from, double to) {
    EdgeZero search(limit, point(from), point(to), point(peak));
    while (!search.done()) search.update(point(search.at()));
    return search;
  };
  const EdgeZero least = zero_from(0.0, end);
  const double a = least.answer().a;
  if (!least.found()) return {end, false, false};
  if (spare_strength(limit, heating, end) > 0.0) return {a, true, true};
  // Above the peak or with a limit that falls with slip H may have other zeros.
  const bool falls = peak == end && !limit.falls_with_slip();
  return {a, true, !falls && zero_from(end, a).answer().a > a * (1.0 + EdgeZero::kSame)};
}

double sliding_stress(const InterfaceOptions& options, const Material& soft, double pressure, double c, double b) {
  StressLimit friction = interface_strength(options, soft, pressure, nullptr);
  friction.tresca = std::numeric_limits<double>::infinity();
  const double at_rest = friction.friction(0.0, 0.0).stress;
  if (c <= 0.0) return at_rest;
  const SlipSearch slip = most_slip_stress(friction, {0.0, 0.0, c, b}, std::numeric_limits<double>::infinity());
  return slip.found ? slip.stress : at_rest;
}

}  // namespace shearbus::physics
