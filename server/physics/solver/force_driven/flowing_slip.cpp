#include "server/physics/solver/force_driven/flowing_slip.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {
namespace {

constexpr double kAtCeiling = 1e-11;  // relative: a stress this little above the ceiling is at it
constexpr int kMostUlps = 1 << 26;    // what the searches leave open
constexpr double kBeyond = 1e-10;     // relative: put on a bound that is no answer

// Where the slip of light bodies under large forces is coarse (a difference of numbers 1e16 times larger), an ulp of
// the stress may melt the layer: the answer is on the cold side.
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
  // At the end of the step [V]new + drive = sqrt(3) integral(dep)/dt; with it [v] = ([V]old - [V]new)/2.
  stopping_ = {T_ad, rise, -0.5 * trial_.direction * start.dt * start.forcing.acceleration, -0.5 * trial_.per_stress};
  compliance_ = kSqrt3 / (start.dt * trial_.per_stress);

  // 1. The answer of a layer that does not flow is an answer if the layer does not flow under it. A stuck interface
  //    comes loose only when it cannot stick, and a flowing layer helps it stick.
  rigid_ = rigid_slip(start.limit, {start.limit.coulomb, start.limit.coulomb}, trial_, start.heat_partition, B0, T_ad,
                      std::abs(start.before.stress), start.before.sticks);
  if (rigid_.sticks || !start.before.sticks || rigid_.stress == 0.0) {  // a molten interface sticks to nothing
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

// What the layer carries at most: the ceiling of its weakest vertex.
double FlowingSlip::layer_at(double q) const {
  const double T = start_.layer.T(start_.layer.hottest(q), q);
  const double g = softening(*start_.limit.soft, start_.limit.pressure, T).g;
  return g > 0.0 ? start_.ceiling * g : 0.0;
}

bool FlowingSlip::rigid_holds(double slip) const {
  return !(slip > 0.0) && std::abs(rigid_.stress) <= layer_at(rigid_.flux) * (1.0 + kAtCeiling);
}

// The heat flux from `lo` on up to the one that makes T0 = T_hi where `holds` comes true, to the resolution of T0.
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

void FlowingSlip::take(double slip) {
  switch (phase_) {
    case Phase::kDone:
      return;
    case Phase::kRigid:
      if (rigid_holds(slip)) {
        kind_ = Kind::kRigid;
        phase_ = Phase::kDone;
      } else if (stick_tried_) {
        begin_slip();
      } else {
        begin_stick();
      }
      return;
    case Phase::kOtherAnswer:
      several_ = rigid_holds(slip);
      ask(Phase::kDone, a_stick_, start_.heat_partition * (a_stick_ * stopping_.slip(a_stick_)));
      return;
    case Phase::kStickEnd: {
      const double balance = stick_balance(slip);
      if (balance <= 0.0 || a_ == 0.0) {
        at_ceiling_ = high_is_ceiling_;
        return end_stick(a_);
      }
      search_ = RootSearch(0.0, -trial_.stress_stick, a_, balance, trial_.stress_stick,
                           trial_.direction * start_.before.stress);
      break;
    }
    case Phase::kStick:
      if (search_.take(stick_balance(slip))) return end_stick(search_.at());
      break;
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
      search_ = RootSearch(low_, low_value_, high_, balance, high_, -1.0);
      return ask_slip(Phase::kSlip, search_.at());
    }
    case Phase::kSlip: {
      if (!search_.take(slip_balance(slip))) return ask_slip(Phase::kSlip, search_.at());
      // Where it is the layer that holds the stress the interface does not slip: the answer has less slip.
      const double q = search_.at();
      if (layer_holds(q)) {
        high_ = q;
        bound_slip_by_layer();
        if (high_ < q) return ask_slip(Phase::kSlipHigh, high_);
      }
      return end_slip(q);
    }
  }
  const double a = search_.at();
  ask(Phase::kStick, a, start_.heat_partition * (a * stopping_.slip(a)));
}

// 2. Stick: the end-of-step slip falls strictly with the stress, as both the flow and its heating rise with it. Its
//    zero lies below what sticks a rigid layer, what the layer carries at most, and where the first vertex alone would
//    take more than there is.
void FlowingSlip::begin_stick() {
  stick_tried_ = true;
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
    const double beyond = hardened_strength(soft, most_strain, (most_strain - start_.first_strain) / start_.dt) * g /
                          kSqrt3 * (1.0 + kBeyond);
    if (beyond < high) {
      high = beyond;
      high_is_ceiling_ = false;
    }
  }
  ask(Phase::kStickEnd, high, start_.heat_partition * (high * stopping_.slip(high)));
}

void FlowingSlip::end_stick(double a) {
  const FrictionHeating flux{0.0, start_.heat_partition, stopping_.c, stopping_.b};
  a = not_molten(flux, start_.layer, start_.limit.soft->melting_temperature, a);
  a_stick_ = a;
  // A layer at a ceiling below the interface's yield, at z = 0, leaves mu P to ask: near melting the two differ by less
  // than T0 resolves.
  const double q = flux.rise * (a * flux.slip(a));
  const bool below_yield = at_ceiling_ && start_.ceiling <= start_.limit.tresca && start_.layer.hottest(q) == 0;
  const double carried = below_yield ? start_.limit.coulomb : interface_at(q);
  const bool can_stick = rigid_.sticks || carried >= a;
  if (can_stick) {
    kind_ = Kind::kStick;
    if (!rigid_.sticks && start_.before.sticks) return ask_rigid(Phase::kOtherAnswer);
    return ask(Phase::kDone, a, start_.heat_partition * (a * stopping_.slip(a)));
  }
  at_ceiling_ = false;
  if (start_.before.sticks) return ask_rigid(Phase::kRigid);
  begin_slip();
}

// 3. Slip, with the heat flux as the unknown: it sets T0, T0 the stress, both the flow of the layer. What the slip
// beside
//    that flow heats is less than the flux at the rigid answer's flux, where the flow takes slip away, and more than
//    the flux where the limit is the stress that would stick.
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

// The interface slips up to the flux at which the layer carries no more than it does: there the layer takes all that is
// left. At `high_`, where this is asked, it carries less.
void FlowingSlip::bound_slip_by_layer() {
  high_ = first_flux(low_, T0(high_), [&](double q) { return layer_holds(q); });
  high_is_ceiling_ = true;
}

void FlowingSlip::ask_slip(Phase phase, double q) {
  ask(phase, std::min(interface_at(q), layer_at(q)), q);
}

double FlowingSlip::slip_beside_flow(double a, double slip) const {
  return std::max(0.0, slipping_.c - slipping_.b * a - kSqrt3 * slip / start_.dt);
}

double FlowingSlip::slip_balance(double slip) const {
  return q_ - start_.heat_partition * (a_ * slip_beside_flow(a_, slip));
}

void FlowingSlip::end_slip(double q) {
  kind_ = Kind::kSlip;
  ask_slip(Phase::kDone, q);
  // Where the last digit of T0 is all that is left to melting: the cold side, on which there is a stress to slip under.
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
  // The slip is what made the heat; where the layer is at its ceiling it takes what is left of (64).
  const double v = a_ > 0.0 ? q_ / (start_.heat_partition * a_) : slip_beside_flow(a_, slip);
  const double left = slipping_.c - slipping_.b * a_ - v;
  const double surplus = at_ceiling_ ? std::max(0.0, left * start_.dt / kSqrt3 - slip) : 0.0;
  const Regime regime = slip_regime(start_.limit, T0(q_), v);
  return {{d * a_, d * v, trial_.jump_new(a_), q_, regime, false, rigid_.unique, rigid_.several}, surplus, hottest};
}

}  // namespace shearbus::physics
