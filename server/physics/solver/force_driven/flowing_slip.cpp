#include "server/physics/solver/force_driven/flowing_slip.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {
namespace {

constexpr double kAtCeiling = 1e-11;   // a stress within this relative distance of the layer's ceiling counts as equal
constexpr int kMostUlps = 1 << 26;     // largest correction of a stress or temperature at the end of a search, in ulps
constexpr double kSurely = 1e-9;       // a stress this far above the flow stress, relative to it, makes a layer flow
constexpr double kClosed = 1e-12;      // largest accepted residual of the flux, relative to it
constexpr double kLeastGuess = 1e-12;  // smallest useful first stress, relative to the upper end of its interval
constexpr int kMostGuesses = 6;        // largest number of stresses tried below the root before the upper end
constexpr int kNearbySteps = 6;        // most steps of Newton's method with the flow nearby
constexpr double kNearbyMet = 1e-13;   // a relative step below this one ends them
constexpr double kBeyond = 1e-10;      // relative margin added to an upper bound of the stress, against rounding

// The slip of light bodies under large forces is a difference of numbers up to 1e16 times larger, so one ulp of the
// stress may melt the layer. The answer is then reduced until the layer stays below melting.
double not_molten(const FrictionHeating& heating, const Heated& layer, double T_melt, double a) {
  if (layer.T(layer.hottest(0.0), 0.0) >= T_melt) return a;
  const auto hottest = [&](double stress) {
    const double q = heating.rise * (stress * heating.slip(stress));
    return layer.T(layer.hottest(q), q);
  };
  for (int ulps = 1; hottest(a) >= T_melt && ulps < kMostUlps; ulps *= 2) {
    a *= 1.0 - ulps * std::numeric_limits<double>::epsilon();
  }
  return a;
}

}  // namespace

FlowingSlip::FlowingSlip(const FlowingStart& start)
    : start_(start), trial_(start.forcing, start.dt, start.before.jump_new, start.before.stress) {
  const double T_ad = T0(0.0);
  const double B0 = start.layer.response(0);
  const double rise = start.heat_partition * B0;
  slipping_ = trial_.slipping(T_ad, rise);
  // If the interface sticks at the end of the step, the flow of the layer takes all of [V]new + drive there. The mean
  // slip velocity of the interface over the step is then [v] = ([V]old - [V]new)/2.
  stopping_ = {T_ad, rise, -0.5 * trial_.direction * start.dt * start.forcing.acceleration, -0.5 * trial_.per_stress};
  compliance_ = kSqrt3 / (start.dt * trial_.per_stress);

  // 1. The answer found for a layer that cannot flow is an answer of the step if the real layer does not flow under
  //    the stress of this answer. An interface that was stuck begins to slip only if it cannot stick while the layer
  //    flows.
  rigid_ = rigid_slip(start.limit, trial_, start.heat_partition, B0, T_ad, std::abs(start.before.stress),
                      start.before.sticks);
  //    At stress 0 the interface is molten and cannot stick.
  const bool rigid_comes_first = rigid_.sticks || !start.before.sticks || rigid_.stress == 0.0;
  if (rigid_comes_first && !rigid_layer_flows()) {
    ask_rigid(Phase::kRigid);
  } else {
    begin_stick();
  }
}

void FlowingSlip::ask(Phase phase, double a, double q) {
  phase_ = phase;
  a_ = a;
  q_ = q;
}

void FlowingSlip::ask_rigid(Phase phase) {
  ask(phase, std::abs(rigid_.stress), rigid_.flux);
}

// The largest stress that the layer carries under the heat flux q: the stress ceiling of its hottest vertex.
double FlowingSlip::layer_at(double q) const {
  const double T = start_.layer.T(start_.layer.hottest(q), q);
  const double g = softening(*start_.limit.soft, start_.limit.pressure, T).g;
  return g > 0.0 ? start_.ceiling * g : 0.0;
}

bool FlowingSlip::rigid_holds(double slip) const {
  return !(slip > 0.0) && std::abs(rigid_.stress) <= layer_at(rigid_.flux) * (1.0 + kAtCeiling);
}

// Whether the layer flows at z = 0 under the stress of the answer for a rigid layer, which needs no sum to be seen.
// Otherwise it may flow all the same.
bool FlowingSlip::rigid_layer_flows() const {
  const double yield =
      flow_stress(*start_.limit.soft, start_.first_strain, start_.limit.pressure, T0(rigid_.flux)) / kSqrt3;
  return start_.hardens && std::abs(rigid_.stress) > yield * (1.0 + kSurely);
}

// Finds the smallest heat flux at which `holds` is true, between `lo` and the flux that makes T0 = T_hi, to the
// resolution of T0.
template <class Predicate>
double FlowingSlip::first_flux(double lo, double T_hi, const Predicate& holds) const {
  const double T_ad = T0(0.0);
  const double B0 = start_.layer.response(0);
  double cold = T0(lo), hot = T_hi;
  for (;;) {
    const double mid = 0.5 * (cold + hot);
    if (mid <= cold || mid >= hot) return std::max(lo, (hot - T_ad) / B0);
    (holds((mid - T_ad) / B0) ? hot : cold) = mid;
  }
}

// Whether the stress under which the flow was summed is the answer of the stuck balance.
bool FlowingSlip::stick_is_met(double slip, const NearbyFlow& nearby) const {
  return nearby.base > 0.0 && is_balanced(a_, trial_.stress_stick - a_, compliance_, slip, nearby.accuracy);
}

// The stress that meets the stuck balance with the flow nearby, by Newton's method; -1 where that is not known.
double FlowingSlip::nearby_stick(const NearbyFlow& nearby) const {
  if (!(nearby.base > 0.0)) return -1.0;
  double a = a_;
  for (int step = 0; step < kNearbySteps; ++step) {
    const NearbyFlow::Slip flow = nearby.at(a, stick_flux(a));
    const double flux_slope =
        stopping_.slip(a) > 0.0 ? start_.heat_partition * (stopping_.c - 2.0 * stopping_.b * a) : 0.0;
    const double open = a + compliance_ * flow.value - trial_.stress_stick;
    const double next = a - open / (1.0 + compliance_ * (flow.by_stress + flow.by_flux * flux_slope));
    if (!(next > 0.0)) return -1.0;
    const double change = std::abs(next - a);
    a = next;
    if (change <= kNearbyMet * a) break;
  }
  return a;
}

// The flux that meets the balance of an interface that slips, likewise.
double FlowingSlip::nearby_slip(const NearbyFlow& nearby) const {
  if (!(nearby.base > 0.0)) return -1.0;
  double q = q_;
  for (int step = 0; step < kNearbySteps; ++step) {
    const StressLimit::Value limit = start_.limit.at(T0(q));
    const double layer = layer_at(q);
    if (layer < limit.stress || !(limit.stress > 0.0)) return -1.0;
    const double a = limit.stress, by_flux = limit.slope * start_.layer.response(0);
    const NearbyFlow::Slip flow = nearby.at(a, q);
    const double v = interface_slip(a, flow.value);
    const double v_slope =
        v > 0.0 ? -slipping_.b * by_flux - kSqrt3 / start_.dt * (flow.by_stress * by_flux + flow.by_flux) : 0.0;
    const double open = q - start_.heat_partition * (a * v);
    const double next = q - open / (1.0 - start_.heat_partition * (by_flux * v + a * v_slope));
    if (!(next > 0.0)) return -1.0;
    const double change = std::abs(next - q);
    q = next;
    if (change <= kNearbyMet * q) break;
  }
  return q;
}

void FlowingSlip::update(double slip, const NearbyFlow& nearby) {
  switch (phase_) {
    case Phase::kDone:
      return;
    case Phase::kRigid:
      if (rigid_holds(slip)) {
        kind_ = Kind::kRigid;
        phase_ = Phase::kDone;
      } else if (stick_was_searched_) {
        begin_slip();
      } else {
        begin_stick();
      }
      return;
    case Phase::kOtherAnswer:
      several_ = rigid_holds(slip);
      return ask_stick(Phase::kDone, a_stick_);
    case Phase::kStickGuess:
      return guess_stick(slip, nearby);
    case Phase::kStickEnd: {
      const double balance = stick_balance(slip);
      if (balance <= 0.0 || a_ == 0.0) {
        at_ceiling_ = high_is_ceiling_;
        return end_stick(a_);
      }
      const double known = nearby_stick(nearby);
      search_ = RootSearch(low_, low_value_, a_, balance, trial_.stress_stick,
                           known > 0.0 ? known : trial_.direction * start_.before.stress);
      return ask_stick(Phase::kStick, search_.at());
    }
    case Phase::kStick:
      if (stick_is_met(slip, nearby)) return end_stick(a_);
      if (search_.update(stick_balance(slip))) return end_stick(search_.at());
      search_.prefer(nearby_stick(nearby));
      return ask_stick(Phase::kStick, search_.at());
    case Phase::kSlipLow:
      low_value_ = slip_balance(slip);
      if (low_value_ >= 0.0) return end_slip(low_);
      return ask_slip(Phase::kSlipHigh, high_);
    case Phase::kSlipHigh: {
      const double balance = slip_balance(slip);
      if (balance <= 0.0) {
        at_ceiling_ = high_is_ceiling_;
        return end_slip(high_);
      }
      search_ = RootSearch(low_, low_value_, high_, balance, high_, nearby_slip(nearby));
      return ask_slip(Phase::kSlip, search_.at());
    }
    case Phase::kSlip: {
      const bool met = nearby.base > 0.0 && std::abs(slip_balance(slip)) <= kClosed * q_;
      if (!met && !search_.update(slip_balance(slip))) {
        search_.prefer(nearby_slip(nearby));
        return ask_slip(Phase::kSlip, search_.at());
      }
      // If at the flux found the layer carries a smaller stress than the interface, the answer has less flux and slip.
      const double q = met ? q_ : search_.at();
      if (layer_holds(q)) {
        high_ = q;
        bound_slip_by_layer();
        if (high_ < q) return ask_slip(Phase::kSlipHigh, high_);
      }
      return end_slip(q);
    }
  }
}

void FlowingSlip::ask_stick(Phase phase, double a) {
  ask(phase, a, stick_flux(a));
}

// 2. Stick: the slip at the end of the step falls strictly with the stress, because flow and heating rise with the
//    stress. The root lies below three bounds: the sticking stress of a rigid layer, the largest stress that the layer
//    carries, and the stress under which the first vertex alone would flow by more than all the slip.
void FlowingSlip::begin_stick() {
  stick_was_searched_ = true;
  const Material& soft = *start_.limit.soft;
  const double most_ad = layer_at(0.0);
  double high = trial_.stress_stick;
  high_is_ceiling_ = false;
  if (most_ad <= 0.0) {
    high = 0.0;
    high_is_ceiling_ = true;
  } else if (std::isfinite(start_.ceiling)) {
    const StressLimit layer{std::numeric_limits<double>::infinity(), start_.ceiling, start_.limit.pressure, &soft};
    int hottest = start_.layer.hottest(0.0);
    const double most = ceiling_stress(layer, start_.layer, {0.0, start_.heat_partition, stopping_.c, stopping_.b},
                                       high, std::abs(start_.before.stress), hottest);
    if (most < high) {
      high = most;
      high_is_ceiling_ = true;
    }
  }
  if (most_ad > 0.0 && start_.hardens) {
    const double g = softening(soft, start_.limit.pressure, T0(0.0)).g;
    const double most_strain = start_.first_strain + trial_.stress_stick / compliance_ / start_.first_weight;
    const double beyond = hardened_strength(soft, most_strain, (most_strain - start_.first_strain) / start_.dt,
                                            start_.limit.pressure, T0(0.0)) *
                          g / kSqrt3 * (1.0 + kBeyond);
    if (beyond < high) {
      high = beyond;
      high_is_ceiling_ = false;
    }
  }
  low_ = 0.0;
  low_value_ = -trial_.stress_stick;
  high_ = high;
  guesses_ = 0;
  const double guess = trial_.direction * start_.before.stress;
  const bool starts_inside = start_.knows_nearby && guess > kLeastGuess * high && guess < high;
  ask_stick(starts_inside ? Phase::kStickGuess : Phase::kStickEnd, starts_inside ? guess : high);
}

// The stuck balance under a guess of the stress: the flow nearby tells the next guess, and the upper end of the interval
// is evaluated only where no guess lies above the root.
void FlowingSlip::guess_stick(double slip, const NearbyFlow& nearby) {
  const double balance = stick_balance(slip);
  if (stick_is_met(slip, nearby)) return end_stick(a_);
  const double next = nearby_stick(nearby);
  if (balance > 0.0) {
    search_ = RootSearch(low_, low_value_, a_, balance, trial_.stress_stick, next);
    return ask_stick(Phase::kStick, search_.at());
  }
  low_ = a_;
  low_value_ = balance;
  if (next > a_ && next < high_ && ++guesses_ < kMostGuesses) return ask_stick(Phase::kStickGuess, next);
  ask_stick(Phase::kStickEnd, high_);
}

void FlowingSlip::end_stick(double a) {
  const FrictionHeating flux{0.0, start_.heat_partition, stopping_.c, stopping_.b};
  a = not_molten(flux, start_.layer, start_.limit.soft->melting_temperature, a);
  a_stick_ = a;
  // If the stress is the layer's ceiling at z = 0, and the interface's yield limit is not below that ceiling, then only
  // friction can keep the interface from sticking. The stress is not compared with the yield limit: near melting, limit
  // and ceiling differ by less than the effect of a rounding error of T0.
  const double q = flux.rise * (a * flux.slip(a));
  const bool below_yield = at_ceiling_ && start_.ceiling <= start_.limit.tresca && start_.layer.hottest(q) == 0;
  const double carried = below_yield ? start_.limit.friction(T0(q)).stress : interface_at(q);
  const bool can_stick = rigid_.sticks || carried >= a;
  if (can_stick) {
    kind_ = Kind::kStick;
    if (!rigid_.sticks && start_.before.sticks && !rigid_layer_flows()) return ask_rigid(Phase::kOtherAnswer);
    return ask_stick(Phase::kDone, a);
  }
  at_ceiling_ = false;
  if (start_.before.sticks && !rigid_layer_flows()) return ask_rigid(Phase::kRigid);
  begin_slip();
}

// 3. Slip. The unknown is the heat flux q. It gives T0, T0 gives the stress, and both give the flow of the layer. The
//    rest of the slip must heat by q. At the flux of the answer for a rigid layer it heats by less than q, because the
//    layer takes a part of the slip. At the flux where the stress limit falls to the sticking stress (or at q = 0) it
//    heats by more than q. The root lies between these two fluxes.
void FlowingSlip::begin_slip() {
  const double T_melt = start_.limit.soft->melting_temperature;
  low_ = 0.0;
  if (T0(0.0) < T_melt && std::min(interface_at(0.0), layer_at(0.0)) > a_stick_) {
    low_ = first_flux(0.0, T_melt, [&](double q) { return std::min(interface_at(q), layer_at(q)) <= a_stick_; });
  }
  high_ = rigid_.flux;
  high_is_ceiling_ = false;
  if (high_ > low_ && layer_holds(high_)) bound_slip_by_layer();
  if (high_ <= low_) {
    at_ceiling_ = high_is_ceiling_;
    return end_slip(high_);
  }
  ask_slip(Phase::kSlipLow, low_);
}

// Reduces `high_` to the smallest flux at which the layer carries a smaller stress than the interface. At larger fluxes
// the interface does not slip further, because the flow of the layer takes the rest of the slip. Called if the layer
// carries a smaller stress than the interface at `high_`.
void FlowingSlip::bound_slip_by_layer() {
  high_ = first_flux(low_, T0(high_), [&](double q) { return layer_holds(q); });
  high_is_ceiling_ = true;
}

void FlowingSlip::ask_slip(Phase phase, double q) {
  ask(phase, std::min(interface_at(q), layer_at(q)), q);
}

double FlowingSlip::interface_slip(double a, double slip) const {
  return std::max(0.0, slipping_.c - slipping_.b * a - kSqrt3 * slip / start_.dt);
}

double FlowingSlip::slip_balance(double slip) const {
  return q_ - start_.heat_partition * (a_ * interface_slip(a_, slip));
}

void FlowingSlip::end_slip(double q) {
  kind_ = Kind::kSlip;
  ask_slip(Phase::kDone, q);
  // If rounding takes T0 up to melting, the stress is 0: lower T0 by a few ulps, until the stress is positive.
  const double T_ad = T0(0.0);
  const double hot = T0(q);
  for (int ulps = 1; a_ <= 0.0 && q_ > 0.0 && ulps < kMostUlps; ulps *= 2) {
    const double T = hot * (1.0 - ulps * std::numeric_limits<double>::epsilon());
    ask_slip(Phase::kDone, std::max(0.0, (T - T_ad) / start_.layer.response(0)));
  }
}

FlowingSlip::Answer FlowingSlip::answer(double slip) const {
  if (kind_ == Kind::kRigid) return {rigid_, 0.0, 0};
  const int hottest = start_.layer.hottest(q_);
  const double d = trial_.direction;
  if (kind_ == Kind::kStick) {
    const double surplus = at_ceiling_ ? std::max(0.0, (trial_.stress_stick - a_) / compliance_ - slip) : 0.0;
    const bool flows = slip > 0.0 || surplus > 0.0;
    const bool melting = start_.layer.T(hottest, q_) >= kMeltingShare * start_.limit.soft->melting_temperature;
    const Regime regime = !flows ? Regime::kStick : melting ? Regime::kMelting : Regime::kTresca;
    return {{d * a_, d * stopping_.slip(a_), trial_.jump_new(a_), q_, regime, true, true, several_}, surplus, hottest};
  }
  // The slip of the interface follows from its friction heat. A layer at its stress ceiling flows by the slip that the
  // balance DLP (64) leaves over.
  const double v = a_ > 0.0 ? q_ / (start_.heat_partition * a_) : interface_slip(a_, slip);
  const double left = slipping_.c - slipping_.b * a_ - v;
  const double surplus = at_ceiling_ ? std::max(0.0, left * start_.dt / kSqrt3 - slip) : 0.0;
  const Regime regime = slip_regime(start_.limit, T0(q_), v);
  return {{d * a_, d * v, trial_.jump_new(a_), q_, regime, false, rigid_.unique, rigid_.several}, surplus, hottest};
}

}  // namespace shearbus::physics
