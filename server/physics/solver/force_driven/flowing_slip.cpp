#include "server/physics/solver/force_driven/flowing_slip.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/interface/bisection.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {
namespace {

constexpr double kAtCeiling = 1e-11;   // a stress within this relative distance of the layer's ceiling counts as equal
constexpr int kMostUlps = 1 << 26;     // largest correction of a stress or temperature at the end of a search, in ulps
constexpr double kSurely = 1e-9;       // a stress this far above the flow stress, relative to it, makes a layer flow
constexpr double kByRounding = 1e-11;  // a layer that flows only under the last such part of a stress does not flow
constexpr double kClosed = 1e-12;      // largest accepted residual of the flux, relative to it
constexpr double kLeastGuess = 1e-12;  // smallest useful first stress, relative to the upper end of its interval
constexpr double kNextBlindGuess = 1.02;  // the next stress, relative to one under which nothing flows
constexpr int kMostGuesses = 6;           // largest number of stresses tried below the root before the upper end
constexpr int kNearbySteps = 6;           // most steps of a search with the flow nearby
constexpr double kMostBend = 0.5;         // limit of Halley's correction of Newton's step
constexpr double kNearbyFlowMet = 3e-5;   // a step that changes the flow by less ends a search of third order
constexpr double kNearbyMet = 1e-8;       // a relative step below this one ends them: the error is about its square
constexpr double kBeyond = 1e-10;         // relative margin added to an upper bound of the stress, against rounding

}  // namespace

bool softens_alike(const StressLimit& limit) {
  const bool is_constant = limit.varying == nullptr && limit.junctions.options == nullptr;
  return is_constant && properties_of(limit.soft->flow_law).separable;
}

FlowingSlip::FlowingSlip(const FlowingStart& start)
    : start_(start), trial_(start.forcing, start.dt, start.before.jump_new, start.before.stress) {
  const double T_ad = start.layer.T(0, 0.0);
  const double B0 = start.layer.response(0);
  const double rise = start.heat_partition * B0;
  slipping_ = trial_.slipping(T_ad, rise);
  // If the interface sticks at the end of the step, the flow of the layer takes all of [V]new there. The mean
  // slip velocity of the interface over the step is then [v] = ([V]old - [V]new)/2.
  stopping_ = {T_ad, rise, -0.5 * trial_.direction * start.dt * start.forcing.acceleration, -0.5 * trial_.per_stress};
  // Under a tolerance the flow takes the mean jump, and an interface that sticks does not slip.
  if (start.turns_within) {
    travel_ = Travel(start.forcing, trial_, start.dt);
    stopping_ = {T_ad, rise, 0.0, 0.0};
  }
  compliance_ = kSqrt3 / (start.dt * trial_.per_stress);

  // 1. The answer found for a layer that cannot flow is an answer of the step if the real layer does not flow under
  //    the stress of this answer. An interface that was stuck begins to slip only if it cannot stick while the layer
  //    flows. At stress 0 the interface is molten and cannot stick.
  surely_flows_ = flows_beside_any_rigid_answer();
  const auto rigid_comes_first = [&] { return rigid().sticks || !start.before.sticks || rigid_.stress == 0.0; };
  if (!surely_flows_ && rigid_comes_first() && !rigid_layer_flows()) {
    ask_rigid(Phase::kRigid);
  } else {
    begin_stick();
  }
}

// The answer of the step if the layer does not flow; computed when first asked for.
const LaneStep& FlowingSlip::rigid() {
  if (!rigid_is_known_) {
    const double partition = start_.heat_partition, B0 = start_.layer.response(0), T_ad = start_.layer.T(0, 0.0);
    const double guess = std::abs(start_.before.stress);
    rigid_ = rigid_slip(start_.limit, trial_, partition, B0, T_ad, guess, start_.before.sticks);
    const bool stops = rigid_.sticks || trial_.jump_old < 0.0;
    if (start_.turns_within && stops && !(std::abs(rigid_.stress) >= travel_.rest_stress()))
      rigid_ = travel_.slip_next_to_rigid(start_.limit, partition, B0, T_ad, guess);
    rigid_is_known_ = true;
  }
  return rigid_;
}

void FlowingSlip::ask(Phase phase, const LayerLoad& load) {
  phase_ = phase;
  load_ = load;
}

// A layer that has hardened until it is as strong as the interface would flow or not by rounding, and with that a contact
// that slips would stick or not.
void FlowingSlip::ask_rigid(Phase phase) {
  ask(phase, {std::abs(rigid().stress) * (1.0 - kByRounding), rigid_.flux, 0.0});
}

void FlowingSlip::ask_slip(Phase phase, double v) {
  const bool known = phase_ >= Phase::kSlipLow && v == slip_;  // the load is that of this slip already
  slip_ = v;
  ask(phase, known ? load_ : slip_load(v));
}

// ---- Loads. Plastic work is the stress times what slip leaves of the mean jump, so that its amount belongs to the end of
// the step and all work of the stress is heat; only where it becomes heat is taken from the step before.

LayerLoad FlowingSlip::stick_load(double a) const {
  return slip_load(a, stopping_.slip(a));
}

LayerLoad FlowingSlip::slip_load(double a, double v) const {
  const double flow = heats_by_work() ? std::max(0.0, slipping_.c - slipping_.b * a - v) : 0.0;
  return {a, start_.heat_partition * (a * v), a * flow};
}

// The load of an interface that slips with the velocity v: the stress is its limit at this slip and at the temperature
// that both cause, but not more than the stress that stops the slip by the end of the step.
LayerLoad FlowingSlip::slip_load(double v) const {
  const StressLimit limit = start_.limit.at_slip(v);
  const double T_ad = start_.layer.T(0, 0.0);
  const double B0 = start_.layer.response(0), B0_work = start_.layer.work_response(0);
  FrictionHeating heating{T_ad, start_.heat_partition * B0, v, 0.0};
  if (heats_by_work())
    heating = {T_ad, 1.0, start_.heat_partition * B0 * v + B0_work * (slipping_.c - v), B0_work * slipping_.b};
  double a = slip_stress(limit, heating, a_stick_, load_.stress);
  return slip_load(not_molten(a, [&](double stress) { return slip_load(stress, v); }), v);
}

// The slip of light bodies under large forces is a difference of numbers up to 1e16 times larger, so one ulp of the
// stress may melt the layer. The stress is then reduced until the layer stays below melting.
template <class LoadUnder>
double FlowingSlip::not_molten(double a, const LoadUnder& load_under) const {
  if (melts({})) return a;
  for (int ulps = 1; melts(load_under(a)) && ulps < kMostUlps; ulps *= 2)
    a *= 1.0 - ulps * std::numeric_limits<double>::epsilon();
  return a;
}

// A load with so much less plastic work that the layer stays solid. Only the last digits of the jumps make a step need
// it: under light bodies the work is a difference of numbers up to 1e16 times larger.
LayerLoad FlowingSlip::solid(LayerLoad load) const {
  if (!(load.work > 0.0) || !melts(load)) return load;
  const LayerLoad all = load;
  load.work = bisected(0.0, load.work, [&](double work) { return melts({all.stress, all.flux, work}); }).lo;
  return load;
}

// The largest stress that the layer carries at the temperatures of a load: the stress ceiling of its hottest vertex.
double FlowingSlip::layer_at(const LayerLoad& load) const {
  const double g = softening(*start_.limit.soft, start_.limit.pressure, T(hottest(load), load)).g;
  return g > 0.0 ? start_.ceiling * g : 0.0;
}

// Whether the layer at its ceiling carries less than the limit of an interface that slips with the velocity v.
bool FlowingSlip::layer_holds(double v) const {
  if (std::isinf(start_.ceiling)) return false;
  const LayerLoad load = slip_load(v);
  if (layer_at(load) < load.stress) return true;
  // Where the layer is at its ceiling as the interface sticks, slip that makes the interface stronger than that is the
  // layer's, too.
  return stick_at_ceiling_ && load.stress >= a_stick_ && start_.limit.depends_on_slip() &&
         start_.limit.at(T(0, load), v).stress > load.stress * (1.0 + kAtCeiling);
}

bool FlowingSlip::rigid_holds(double slip) {
  return !(slip > 0.0) && std::abs(rigid().stress) <= layer_at({0.0, rigid_.flux, 0.0}) * (1.0 + kAtCeiling);
}

// Whether the layer flows at z = 0 whatever the answer for a rigid layer is: under the stress that sticks, and where it
// is softest, because its yield stress is below the limit of the interface at all temperatures.
bool FlowingSlip::flows_beside_any_rigid_answer() const {
  constexpr double kClearly = 1.01 / kSqrt3;  // far above rounding, and above the error of an answer near melting
  if (!start_.hardens || !softens_alike(start_.limit)) return false;
  const double strength = kClearly * start_.first_strength, g = start_.first_g;
  return start_.limit.tresca > strength && g > 0.0 && std::min(stress_at_rest(), start_.limit.coulomb) > strength * g;
}

// Whether the layer flows at z = 0 under the stress of the answer for a rigid layer, which needs no sum to be seen.
// Otherwise it may flow all the same.
bool FlowingSlip::rigid_layer_flows() {
  if (surely_flows_) return true;
  const double T0 = start_.layer.T(0, rigid().flux);
  const double yield = flow_stress(*start_.limit.soft, start_.first_strain, start_.limit.pressure, T0) / kSqrt3;
  return start_.hardens && std::abs(rigid_.stress) > yield * (1.0 + kSurely);
}

// ---- The flow nearby

// The stress that meets the stuck balance with the flow nearby, by Halley's method; -1 where that is not known.
double FlowingSlip::nearby_stick(const NearbyFlow& nearby) const {
  if (!(nearby.base > 0.0)) return -1.0;
  double a = load_.stress;
  for (int step = 0; step < kNearbySteps; ++step) {
    const NearbyFlow::Slip flow = nearby.at(a, stick_load(a).heat());
    const double stops = stopping_.slip(a) > 0.0 ? stopping_.c - 2.0 * stopping_.b * a : 0.0;
    double heat_slope = start_.heat_partition * stops;
    if (heats_by_work()) heat_slope += slipping_.c - 2.0 * slipping_.b * a - stops;
    const double flow_slope = compliance_ * (flow.by_stress + flow.by_flux * heat_slope);
    const double slope = flow_slope - left_to_flow_slope(a);
    const double newton = stick_balance(a, flow.value) / slope;
    // Halley's correction for a flow that follows a power of the stress.
    const double moving = compliance_ * (flow.value - nearby.constant);
    const double power = moving > 0.0 ? flow_slope * a / moving : 1.0;
    const double bend = 0.5 * newton * flow_slope * (power - 1.0) / (a * slope);
    const double change = newton / (1.0 - std::clamp(bend, -kMostBend, kMostBend));
    if (!(change < a)) return -1.0;
    a -= change;
    if (power * std::abs(change) <= kNearbyFlowMet * a) break;
  }
  return a;
}

// The slip velocity that meets the balance of an interface that slips, by Newton's method; -1 likewise.
double FlowingSlip::nearby_slip(const NearbyFlow& nearby) const {
  if (!(nearby.base > 0.0)) return -1.0;
  const double B0 = start_.heat_partition * start_.layer.response(0), B0_work = start_.layer.work_response(0);
  const double c = slipping_.c, b = slipping_.b;
  double v = slip_;
  LayerLoad load = load_;
  for (int step = 0; step < kNearbySteps; ++step) {
    const double a = load.stress;
    const StressLimit::Value limit = start_.limit.at(T(0, load), v);
    if (!(limit.stress > 0.0) || a >= a_stick_ || layer_at(load) <= a) return -1.0;
    // The stress is the limit at the temperature that stress and slip cause.
    const double by_slip = (limit.slope * (a * (B0 - B0_work)) + limit.slip_slope()) /
                           (1.0 - limit.slope * (B0 * v + B0_work * (c - 2.0 * b * a - v)));
    double heat_slope = start_.heat_partition * (a + v * by_slip);
    if (heats_by_work()) heat_slope += (c - 2.0 * b * a - v) * by_slip - a;
    const NearbyFlow::Slip flow = nearby.at(a, load.heat());
    const double per_time = kSqrt3 / start_.dt;
    const double open = v + per_time * flow.value - mean_jump(a);
    const double next = v - open / (1.0 + per_time * (flow.by_stress * by_slip + flow.by_flux * heat_slope) -
                                    mean_jump_slope(a) * by_slip);
    if (!(next > 0.0)) return -1.0;
    const double change = std::abs(next - v);
    v = next;
    if (change <= kNearbyMet * v) break;
    load = slip_load(v);
  }
  return v;
}

void FlowingSlip::update(double slip, const NearbyFlow& nearby) {
  if (std::isnan(load_.stress)) {  // a contact law gave no number, and the lane has none either
    kind_ = Kind::kSlip;
    phase_ = Phase::kDone;
  }
  switch (phase_) {
    case Phase::kDone:
      return;
    case Phase::kRigid:
      if (rigid_holds(slip)) {
        kind_ = Kind::kRigid;
        phase_ = Phase::kDone;
      } else if (stick_was_searched_) {
        load_.stress = std::abs(rigid_.stress);
        begin_slip();
      } else {
        begin_stick();
      }
      return;
    case Phase::kOtherAnswer:
      several_ = rigid_holds(slip);
      return ask(Phase::kDone, solid(stick_load(a_stick_)));
    case Phase::kStickGuess:
      return guess_stick(slip, nearby);
    case Phase::kStickEnd: {
      const double balance = stick_balance(slip);
      if (balance <= 0.0 || load_.stress == 0.0) {
        at_ceiling_ = high_is_ceiling_;
        return end_stick(load_.stress);
      }
      const double known = nearby_stick(nearby);
      search_ = RootSearch(low_, low_value_, load_.stress, balance, left_to_flow(0.0),
                           known > 0.0 ? known : trial_.direction * start_.before.stress);
      return ask_stick(Phase::kStick, search_.at());
    }
    case Phase::kStick:
      if (search_.update(stick_balance(slip))) return end_stick(search_.at());
      search_.prefer(nearby_stick(nearby));
      return ask_stick(Phase::kStick, search_.at());
    case Phase::kSlipLow:
      low_value_ = slip_balance(slip);
      if (low_value_ < 0.0) return ask_slip(Phase::kSlipHigh, high_);
      if (low_ == 0.0) return melts(load_) && !stuck_below_limit_ ? stick_below(load_.stress) : end_slip(low_);
      high_ = low_;
      low_ = 0.0;
      return ask_slip(Phase::kSlipLow, low_);
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
      const bool met = nearby.base > 0.0 && std::abs(slip_balance(slip)) <= kClosed * slip_;
      if (!met && !search_.update(slip_balance(slip))) {
        search_.prefer(nearby_slip(nearby));
        return ask_slip(Phase::kSlip, search_.at());
      }
      // If at the slip found the layer carries a smaller stress than the interface, the answer has less slip.
      const double v = met ? slip_ : search_.at();
      if (layer_holds(v)) {
        high_ = v;
        bound_slip_by_layer();
        if (high_ < v) return ask_slip(Phase::kSlipHigh, high_);
      }
      return end_slip(v);
    }
  }
}

// The stress at which a vertex reaches its ceiling as the stress of an interface that sticks rises; `high` if none does.
double FlowingSlip::ceiling_of_stick(double high) const {
  if (heats_by_work()) {
    if (layer_at(stick_load(high)) >= high) return high;
    return bisected(0.0, high, [&](double a) { return layer_at(stick_load(a)) < a; }).lo;
  }
  const StressLimit layer{std::numeric_limits<double>::infinity(), start_.ceiling, start_.limit.pressure,
                          start_.limit.soft};
  int hottest = start_.layer.hottest(0.0);
  return ceiling_stress(layer, start_.layer, {0.0, start_.heat_partition, stopping_.c, stopping_.b}, high,
                        std::abs(start_.before.stress), hottest);
}

// 2. Stick: the slip at the end of the step falls strictly with the stress, because flow and heating rise with the
//    stress. The root lies below three bounds: the sticking stress of a rigid layer, the largest stress that the layer
//    carries, and the stress under which the first vertex alone would flow by more than all the slip.
void FlowingSlip::begin_stick() {
  stick_was_searched_ = true;
  const Material& soft = *start_.limit.soft;
  const int hottest_ad = hottest({});
  const double g_hottest =
      hottest_ad == 0 ? start_.first_g : softening(soft, start_.limit.pressure, T(hottest_ad, {})).g;
  double high = stress_at_rest();
  high_is_ceiling_ = false;
  if (g_hottest <= 0.0) {
    high = 0.0;
    high_is_ceiling_ = true;
  } else if (std::isfinite(start_.ceiling)) {
    const double most = ceiling_of_stick(high);
    high_is_ceiling_ = most < high;
    high = std::min(high, most);
  }
  const auto inside = [&](double a) { return a > kLeastGuess * std::min(high_, trial_.stress_stick) && a < high_; };
  low_ = 0.0;
  low_value_ = -left_to_flow(0.0);
  high_ = high;
  guesses_ = 0;
  // An explicit flow is solved from a good guess without the third bound, unless melting is near or the guess is too low.
  first_vertex_bounds_ = g_hottest > 0.0 && start_.hardens;
  const double last = trial_.direction * start_.before.stress, next = last + start_.rise;
  const bool extrapolates = inside(next);
  const double guess = extrapolates ? next : last;
  bool starts_inside = extrapolates || inside(last);
  if (!starts_inside || !has_explicit_flow(soft.flow_law) || !is_far_from_melting(soft, start_.layer.T(0, 0.0))) {
    bound_stick_by_first_vertex();
    starts_inside = inside(guess);
  }
  ask_stick(starts_inside ? Phase::kStickGuess : Phase::kStickEnd, starts_inside ? guess : high_);
}

// The third bound, where it is not applied yet.
void FlowingSlip::bound_stick_by_first_vertex() {
  if (!first_vertex_bounds_) return;
  first_vertex_bounds_ = false;
  const Material& soft = *start_.limit.soft;
  const double P = start_.limit.pressure, T_ad = start_.layer.T(0, 0.0);
  const double most_strain = start_.first_strain + left_to_flow(0.0) / compliance_ / start_.first_weight;
  const double rate = (most_strain - start_.first_strain) / start_.dt;
  const double beyond = hardened_strength(soft, most_strain, rate, P, T_ad) * start_.first_g / kSqrt3 * (1.0 + kBeyond);
  if (beyond >= high_) return;
  high_ = beyond;
  high_is_ceiling_ = false;
}

// The stuck balance under a guess of the stress: the flow nearby tells the next guess, and the upper end of the interval
// is evaluated only where no guess lies above the root.
void FlowingSlip::guess_stick(double slip, const NearbyFlow& nearby) {
  const double balance = stick_balance(slip), a = load_.stress;
  // Under a stress below all flow stresses nothing is known of the flow nearby.
  const bool blind = start_.turns_within && !(slip > 0.0);
  const double next = blind ? a * kNextBlindGuess : nearby_stick(nearby);
  if (balance > 0.0) {
    search_ = RootSearch(low_, low_value_, a, balance, left_to_flow(0.0), next);
    return ask_stick(Phase::kStick, search_.at());
  }
  low_ = a;
  low_value_ = balance;
  if (guesses_ > 0) bound_stick_by_first_vertex();
  if (next > a && next < high_ && ++guesses_ < kMostGuesses) return ask_stick(Phase::kStickGuess, next);
  bound_stick_by_first_vertex();
  ask_stick(Phase::kStickEnd, high_);
}

void FlowingSlip::end_stick(double a) {
  LayerLoad load = a == load_.stress ? load_ : stick_load(a);
  if (melts(load)) {
    a = not_molten(a, [&](double stress) { return stick_load(stress); });
    load = stick_load(a);
  }
  a_stick_ = a;
  stick_at_ceiling_ = at_ceiling_;
  // If the stress is the layer's ceiling at z = 0, and the interface's yield limit is not below that ceiling, then only
  // friction can keep the interface from sticking. The stress is not compared with the yield limit: near melting, limit
  // and ceiling differ by less than the effect of a rounding error of T0.
  const double T0 = T(0, load);
  const auto carried_by = [&](const StressLimit& limit) {
    const bool below_yield = at_ceiling_ && start_.ceiling <= limit.tresca && hottest(load) == 0;
    return below_yield ? limit.friction(T0).stress : limit.at(T0).stress;
  };
  const auto carries = [&] {
    if (!start_.limit.depends_on_slip()) return start_.limit.surely_carries(a, T0) || carried_by(start_.limit) >= a;
    return carried_by(start_.limit.at_slip(stopping_.slip(a))) >= a;
  };
  // An interface that would stick next to a rigid layer sticks next to one that takes a part of the slip, unless its
  // limit follows the slip or the work of the layer heats it.
  const auto surely = [&] { return !heats_by_work() && !start_.limit.depends_on_slip() && rigid().sticks; };
  if (carries() || surely()) {
    kind_ = Kind::kStick;
    if (start_.before.sticks && !rigid_layer_flows() && !rigid().sticks) return ask_rigid(Phase::kOtherAnswer);
    return ask(Phase::kDone, load.work > 0.0 ? solid(load) : load);
  }
  at_ceiling_ = false;
  if (start_.before.sticks && !rigid_layer_flows() && !rigid().sticks) return ask_rigid(Phase::kRigid);
  begin_slip();
}

// 3. Slip. The unknown is the slip velocity v. The limit of the interface falls with temperature, so v gives one stress,
//    both give heat and flow, and v must be what the flow leaves of the slip. At the slip velocity of the stuck answer,
//    under less stress than that, more is left; at that of the answer for a rigid layer less is left. The root lies
//    between them.
void FlowingSlip::begin_slip() {
  const bool bounded = !rigid().sticks && std::abs(rigid_.stress) <= a_stick_;
  high_ = bounded ? std::abs(rigid_.slip) : std::max(0.0, mean_jump(0.0));
  low_ = stopping_.slip(a_stick_);
  if (high_ <= low_) low_ = 0.0;
  high_is_ceiling_ = false;
  if (high_ > low_ && layer_holds(high_)) bound_slip_by_layer();
  if (high_ <= low_) {
    at_ceiling_ = high_is_ceiling_;
    return end_slip(high_);
  }
  ask_slip(Phase::kSlipLow, low_);
}

// Reduces `high_` to the smallest slip at which the layer carries a smaller stress than the interface. The interface
// does not slip faster, because the flow of the layer takes the rest of the slip. Called if the layer carries a smaller
// stress than the interface at `high_`.
void FlowingSlip::bound_slip_by_layer() {
  high_is_ceiling_ = true;
  high_ = bisected(low_, high_, [&](double v) { return layer_holds(v); }).hi;
}

double FlowingSlip::slip_balance(double slip) const {
  return slip_ - (mean_jump(load_.stress) - kSqrt3 * slip / start_.dt);
}

// Plastic work heats most under half the stress that sticks. So there may be two stresses at which the interface sticks,
// and where it cannot carry the larger one it sticks at the smaller one, if its layer would melt under the stress `high`.
void FlowingSlip::stick_below(double high) {
  stuck_below_limit_ = true;
  low_ = 0.0;
  low_value_ = -left_to_flow(0.0);
  high_ = high;
  high_is_ceiling_ = false;
  ask_stick(Phase::kStickEnd, high_);
}

void FlowingSlip::end_slip(double v) {
  kind_ = Kind::kSlip;
  ask_slip(Phase::kDone, v);
  // At the ceiling of the layer the heat is kept, and with it the temperature of which the ceiling is one.
  if (const double most = layer_at(load_); at_ceiling_ && most > 0.0 && most < load_.stress) {
    slip_ *= load_.stress / most;
    load_.stress = most;
  }
  load_ = solid(load_);
}

FlowingSlip::Answer FlowingSlip::answer(double slip) {
  Answer answer{};
  if (kind_ == Kind::kRigid) {
    answer.step = rigid();
  } else {
    const double d = trial_.direction, a = load_.stress;
    answer.work = load_.work;
    answer.hottest = hottest(load_);
    if (kind_ == Kind::kStick) {
      if (at_ceiling_) answer.surplus = std::max(0.0, left_to_flow(a) / compliance_ - slip);
      const bool flows = slip > 0.0 || answer.surplus > 0.0;
      const bool melting = T(answer.hottest, load_) >= kMeltingShare * start_.limit.soft->melting_temperature;
      const Regime regime = !flows ? Regime::kStick : melting ? Regime::kMelting : Regime::kTresca;
      answer.step = {d * a, d * stopping_.slip(a), trial_.jump_new(a), load_.flux, regime, true, true, several_};
    } else {
      // A layer at its stress ceiling flows by the slip that the balance DLP (64) leaves over.
      if (at_ceiling_) answer.surplus = std::max(0.0, (mean_jump(a) - slip_) * start_.dt / kSqrt3 - slip);
      const Regime regime = slip_regime(start_.limit, T(0, load_), slip_);
      answer.step = {d * a, d * slip_, trial_.jump_new(a), load_.flux, regime, false, rigid().unique, rigid_.several};
    }
  }
  answer.rubs = std::abs(answer.step.slip);
  if (start_.turns_within) answer.step = travel_.answer(answer.step);
  return answer;
}

}  // namespace shearbus::physics
