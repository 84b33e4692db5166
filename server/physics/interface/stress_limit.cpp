#include "server/physics/interface/stress_limit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace shearbus::physics {
namespace {

constexpr int kMaxIterations = 200;    // largest number of iterations of slip_stress(); bisection alone needs 60
constexpr int kNewtonIterations = 12;  // more than Newton's method usually needs; later every second iteration bisects
// The search ends after a Newton step shorter than this fraction of the stress: the next step would be below rounding.
constexpr double kConverged = 1e-9;
constexpr double kLeastGuess = 1e-12;      // smallest starting stress used, relative to the upper end of the bracket
constexpr int kMaxSearchIterations = 400;  // largest number of iterations of approach_zero()

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
  return {s, s.slope * (heating.rise * (heating.c - 2.0 * heating.b * a)) - s.slip_slope * heating.b, slip};
}

// Whether a Newton step from the stress a is so short that the error after the step is below rounding. Where the limit
// depends on the slip (junctions) the step must also be short relative to the slip: near the sticking stress a small
// change of the stress is a large change of the slip. A step of a few ulps is always short.
bool is_short(double step, double a, const Carried& s, double b) {
  constexpr double kUlps = 4.0 * std::numeric_limits<double>::epsilon();
  const double size = std::abs(step);
  return size <= kConverged * a && (s.limit.slip_slope == 0.0 || size * b <= kConverged * s.slip || size <= kUlps * a);
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

StressLimit::Value StressLimit::varying_friction(double temperature, double slip) const {
  const FrictionValue mu = FrictionLaws::with(
      varying->friction_law, [&](auto own) { return decltype(own)::type::at(*varying, *soft, temperature, slip); });
  const double load = share * pressure;
  return {mu.coefficient * load, mu.slope * load, true, mu.slip_slope * load};
}

std::optional<SlidingFriction> StressLimit::varying_friction_of_step(double c, double b, double a_stick) const {
  return FrictionLaws::with(varying->friction_law, [&](auto own) -> std::optional<SlidingFriction> {
    using Law = typename decltype(own)::type;
    if constexpr (Law::kDependsOnSlip) return Law::of_step(*varying, pressure, c, b, a_stick);
    return {};
  });
}

bool StressLimit::depends_on_slip() const {
  return junctions.options != nullptr || (varying != nullptr && properties_of(varying->friction_law).depends_on_slip);
}

StressLimit StressLimit::at_slip(double slip) const {
  StressLimit other = *this;
  if (junctions.options != nullptr) {
    other.tresca = junctions.at(slip).strength;
    other.junctions = {};
  }
  // Friction that depends on slip does not depend on temperature.
  if (varying != nullptr && properties_of(varying->friction_law).depends_on_slip)
    return other.with_friction(friction(0.0, slip).stress);
  return other;
}

double StressLimit::steepest(double coldest, double hottest, double most_slip) const {
  const double strength = junctions.options ? junctions.at(most_slip).strength : tresca;
  const double yield = strength * FlowLaws::with(soft->flow_law, [&](auto law) {
                         return decltype(law)::type::steepest_softening(*soft, pressure, coldest, hottest);
                       });
  if (varying == nullptr) return yield;
  const double rubbing = share * pressure * FrictionLaws::with(varying->friction_law, [&](auto own) {
                           using Law = typename decltype(own)::type;
                           if constexpr (Law::kDependsOnTemperature)
                             return Law::steepest(*varying, *soft, coldest, hottest);
                           else
                             return 0.0;
                         });
  // Both branches of the limit, friction and yield, fall with T0. A branch below the other over the whole range is the
  // limit.
  const double yield_cold = strength * softening(*soft, pressure, coldest).g;
  const double yield_hot = strength * softening(*soft, pressure, hottest).g;
  if (friction(coldest).stress < yield_hot) return rubbing;
  if (yield_cold <= friction(hottest).stress) return yield;
  return std::max(yield, rubbing);
}

double spare_strength(const StressLimit& limit, const FrictionHeating& heating, double a) {
  if (limit.effort != nullptr) ++limit.effort->limit_values;
  return limit.at(heating.temperature(a), heating.slip(a)).stress - a;
}

double slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max, double guess) {
  // The first upper bound of the stress is the limit before friction heats, at the slip without stress, which is the
  // largest slip.
  double hi = std::min(a_max, limit.at(heating.T_ad, heating.slip(0.0)).stress);
  double lo = 0.0;
  if (hi <= 0.0) return 0.0;
  if (spare_strength(limit, heating, hi) >= 0.0) return hi;
  // If the stress `melting` leaves at least half of the frictionless slip c, its heat melts the interface. Then
  // `melting` is an upper bound of the root, and with fast slip it is far below `hi`.
  const double melting = 2.0 * (limit.soft->melting_temperature - heating.T_ad) / (heating.rise * heating.c);
  if (melting < hi && 2.0 * heating.b * melting <= heating.c) hi = melting;
  double a = guess > kLeastGuess * hi && guess < hi ? guess : 0.5 * hi;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Carried s = carried(limit, heating, a);
    const double stress = s.limit.stress;
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
  double solid = 0.0;
  for (;;) {
    const double mid = 0.5 * (solid + a);
    if (mid <= solid || mid >= a) return solid;
    (melts(mid) ? a : solid) = mid;
  }
}

bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max) {
  const double end = std::min(a_max, limit.at(heating.T_ad, heating.slip(0.0)).stress);
  if (2.0 * heating.b * end <= heating.c || heating.c <= 0.0) return true;  // heating rises with stress up to `end`
  const double hottest = heating.temperature(0.5 * heating.c / heating.b);
  // Above the stress of greatest heating the slip is at most c/2, half the slip without friction.
  if (limit.is_constant_below(hottest, heating.slip(end))) return true;
  const double coldest = heating.temperature(end);
  return heating.rise * limit.steepest(coldest, hottest, 0.5 * heating.c) * (2.0 * heating.b * end - heating.c) < 1.0;
}

namespace {

constexpr double kSame = 1e-9;      // relative difference below which two zeros of H count as the same
constexpr double kArrived = 1e-12;  // relative residual below which a stress counts as a zero of H

// Returns the limit of the interface at the temperature that the stress a causes. With junctions, whose strength
// depends on slip, the limit also depends on the slip and so on the stress: the result is then the stress that equals
// the limit at this temperature and at the slip under this same stress.
double carried_where(const StressLimit& limit, const FrictionHeating& heating, double a) {
  const double T0 = heating.temperature(a);
  if (limit.effort != nullptr) ++limit.effort->limit_values;
  if (!limit.junctions.options) return limit.at(T0).stress;
  return slip_stress(limit, {T0, 0.0, heating.c, heating.b}, std::numeric_limits<double>::infinity(), a);
}

// Replaces the stress a by the limit s_lim(T0(a)) again and again. This limit rises with a above the stress of greatest
// heating. From a start with spare strength H > 0 the stress climbs to the next zero of H, from H < 0 it falls to the
// next zero below, and it cannot jump over a zero. It stops at `begin` or `end`, or after kMaxSearchIterations.
double approach_zero(const StressLimit& limit, const FrictionHeating& heating, double a, double begin, double end) {
  for (int iteration = 0; iteration < kMaxSearchIterations; ++iteration) {
    const double next = std::clamp(carried_where(limit, heating, a), begin, end);
    const bool arrived = std::abs(next - a) <= 4.0 * std::numeric_limits<double>::epsilon() * a;
    a = next;
    if (arrived || a == begin || a == end) break;
  }
  return a;
}

}  // namespace

SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max) {
  const double end = std::min(a_max, limit.at(heating.T_ad, heating.slip(0.0)).stress);
  const double spare_end = spare_strength(limit, heating, end);
  // 1. Up to the stress of greatest heating the spare strength H falls, so it has at most one zero there.
  const double peak = heating.b > 0.0 && heating.c > 0.0 ? std::min(end, 0.5 * heating.c / heating.b) : end;
  if (peak == end && spare_end > 0.0) return {end, false, false};
  if (spare_strength(limit, heating, peak) <= 0.0) {
    const double a = slip_stress(limit, heating, peak, peak);
    if (peak == end) return {a, true, false};
    const double last = spare_end > 0.0 ? end : approach_zero(limit, heating, end, peak, end);
    return {a, true, last > peak * (1.0 + kSame)};
  }
  // 2. Find the first zero of H above the stress of greatest heating, if there is one.
  double a = approach_zero(limit, heating, peak, peak, end);
  if (a == end) return {end, spare_end <= 0.0, false};
  if (spare_end > 0.0) {
    const bool found = std::abs(spare_strength(limit, heating, a)) <= kSame * a;
    return found ? SlipSearch{a, true, false} : SlipSearch{end, false, false};
  }
  const double last = approach_zero(limit, heating, end, peak, end);
  // 3. Where two zeros of H nearly coincide, approach_zero() converges slowly and may stop before it arrives. H changes
  // sign between a and `last`, so bisection finds the zero.
  double hi = last;
  while (spare_strength(limit, heating, a) > kArrived * a) {
    const double mid = 0.5 * (a + hi);
    if (mid <= a || mid >= hi) break;
    (spare_strength(limit, heating, mid) > 0.0 ? a : hi) = mid;
  }
  return {a, true, last > a * (1.0 + kSame)};
}

}  // namespace shearbus::physics
