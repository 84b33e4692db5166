#include "server/physics/solver/around/substep_error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/interface/friction.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"

namespace shearbus::physics {
namespace {

constexpr double kJumpTime = 1e-6;  // time for which friction is taken to act with a wrong velocity jump  [s]
// Lower bound of a step's heat scale, as a fraction of the heat that raises T0 by T_melt - T_start.
constexpr double kLeastHeat = 0.03;
constexpr double kLeastRange = 0.01;  // smallest temperature range that a tolerance refers to, relative to T_melt
// The largest error that backward Euler leaves of a change of T0, or of what a sudden change of the flux makes of T0.
constexpr double kFirstOrderShare = 0.15;
// The error that the last stress, held throughout, leaves of the time integral, relative to the change of the stress. It
// would be a half on a straight path and a third on one that falls like sqrt(t); rises and falls partly cancel.
constexpr double kHeldShare = 0.4;
// The error of T0 of second order, relative to its distance from backward Euler: the most where friction starts.
constexpr double kPieceShare = 1.25;
// The error that two halves leave of heat and impulse, relative to their distance from one piece, where both are of
// second order. It would be a third if nothing were sudden.
constexpr double kHeatShare = 0.5;
// The error that two halves of second order leave of what a flux that starts suddenly and goes on rising makes of T0,
// relative to what its rise makes of it.
constexpr double kCornerShare = 0.003;
// Least start of the flux, relative to its rise, for which one piece and two halves may agree by chance.
constexpr double kLeastStart = 0.25;
// The same of the impulse of a path that bends, relative to the bend, once its error of second order is extrapolated.
constexpr double kBendShare = 0.025;
// The same of the path of a force-driven flow by Simpson's rule.
constexpr double kFlowBendShare = 0.05;

// Error of the velocity jump at the end of a substep in which the jump reverses or stops; `before` and `after` are the
// jump at the two ends of the substep. One stress s acts over the whole substep, although friction really has the other
// sign until the reversal. Both halves of the substep can have this error, so comparing them does not show it. Let the
// jump change by A in the substep, to which s contributes b s. The true rate of change is A + 2 b s per substep until
// the reversal, and A afterwards: the returned error is the difference. If the jump stops although the far stresses
// are larger than the friction before the substep, the stop is doubtful and the error is bounded by the old jump.
double turning_error(const Forcing& forcing, double dt, double before, double after, double stress_before,
                     double stress) {
  if (before == 0.0 || before * after > 0.0) return 0.0;
  if (after == 0.0) {
    const bool holds = std::abs(forcing.acceleration) <= forcing.mobility * std::abs(stress_before);
    return holds ? 0.0 : std::abs(before);
  }
  const double rise = std::abs(before) + std::abs(after);
  const double turned = 2.0 * dt * forcing.mobility * std::abs(stress);
  return std::abs(before) / (1.0 + rise / turned);
}

// Friction work that the answer of a part of a substep leaves out where its slip stops or turns against the far stresses:
// one stress acts, along the jump after the part, and slip of the other sign before it is taken as 0. If the jump stops,
// the work is at most the kinetic energy of the jump before; if it turns, twice that of the slip until then  [J/m2].
double lost_work(const Forcing& forcing, double dt, double before, double after, double stress) {
  const double free = before + dt * forcing.acceleration;
  if (before == 0.0 || before * free >= 0.0) return 0.0;
  const double energy = 0.5 * before * before / forcing.mobility;
  if (after == 0.0) return energy;
  const double until = dt * std::abs(before) / (std::abs(before) + std::abs(after));
  return std::min(2.0 * energy, std::abs(stress * before) * until);
}

// The stress from which the path of a substep starts: an open interface loses its stress at once.
double start_of(const Substep& substep, const SubstepAnswer& answer) {
  return answer.regime == Regime::kOpen ? 0.0 : substep.stress_before;
}

bool flows(const SubstepAnswer& answer) {
  return answer.regime != Regime::kStick;
}

}  // namespace

SubstepErrors::SubstepErrors(const Problem& problem, const TileInputs& inputs, double dt, double response)
    : problem_(problem),
      inputs_(inputs),
      dt_(dt),
      response_(response),
      forced_(problem.options.strategy == Strategy::kForceDriven),
      stops_within_(forced_ && problem.options.plastic_layer),
      sheared_(!forced_ && problem.options.drive == Drive::kLayerShear) {
  const Material& soft = problem.options.soft;
  const double T_melt = soft.melting_temperature, T_start = problem.options.initial_temperature;
  range_ = std::max(T_melt - T_start, kLeastRange * T_melt);
  if (forced_) return;
  for (const int l : lanes_of(inputs.active)) {
    const double pressure = std::max(inputs.pressure[l], 0.0);
    strength_[l] = flow_stress(at_pressure(soft, pressure), 0.0, pressure, T_start) / kSqrt3;
  }
}

// Friction heat per impulse of the stress along the jump  [m/s].
double SubstepErrors::heating(const Substep& substep) const {
  return problem_.heat_partition * std::abs(substep.velocity_jump);
}

// Heat that is off shows in T0 once it leaves melting. Over a run the errors of heat and impulse add up to no larger a
// fraction of the sum of their scales than in each step.
double SubstepErrors::largest(const Substep& substep, double stress, const Errors& errors) const {
  const double T0 = std::max(errors.T0, response_ / dt_ * errors.heat) / range_;
  const double most = std::max({strength_[substep.lane], std::abs(substep.stress_before), std::abs(stress)});
  if (forced_ || !(most > 0.0)) return T0;
  const double most_heat = std::max(heating(substep) * most * dt_, kLeastHeat * range_ * dt_ / response_);
  return std::max({T0, errors.heat / most_heat, errors.mean / most});
}

// Error of the heat of the parts of a velocity-driven substep, all of one length. The elastic part of the path of the
// stress, along which the stress changes by G0 |w| / h per time, is only a part of a substep if the stress passes zero
// or reaches the flow stress there. Two halves may both miss that part, so comparing them with one piece does not show
// its error. A rise that goes on at the same rate in the second half is hardening.
double SubstepErrors::elastic_path(const Substep& substep, const SubstepAnswer* parts, int num_parts) const {
  const double V = substep.velocity_jump, heats = heating(substep);
  if (!sheared_ || V == 0.0) return 0.0;
  const double dt = substep.length * dt_ / num_parts;
  const double rate = problem_.options.soft.shear_modulus * std::abs(V) / problem_.options.grid.thickness;  // [Pa/s]
  double error = 0.0, s = substep.stress_before;
  for (int i = 0; i < num_parts; ++i) {
    const SubstepAnswer& part = parts[i];
    const double before = s;
    const bool turns = before * part.stress < 0.0;
    double rise = std::abs(part.stress) - (turns ? 0.0 : std::abs(before));
    if (i == 0 && num_parts > 1 && !turns) rise -= std::max(0.0, std::abs(parts[1].stress) - std::abs(part.stress));
    const bool meets_flow = flows(part) && !(i == 0 ? substep.flowed : flows(parts[0]));
    s = part.stress;
    if (!(part.stress * V > 0.0) || !(rise > 0.0) || !(turns || meets_flow)) continue;
    const double while_rising = 0.5 * rise * rise / rate;  // of the time integral of the stress  [Pa s]
    if (!turns) {
      error += heats * while_rising;
      continue;
    }
    const double after_turning = std::max(0.0, dt - std::abs(before) / rate);
    error += std::abs(part.heat - heats * (std::abs(part.stress) * after_turning - while_rising));
  }
  return error;
}

// Error of T0 of two halves of a substep whose heat flux starts suddenly and rises in the same direction. One piece makes
// 0.059 too much of the start and 0.018 too little of the rise, so that it may agree with two halves, which make 0.001
// and 0.0024 too little: both are wrong. A quarter of the rise is the start with which they agree.  [K]
double SubstepErrors::corner_of_flux(const Substep& substep, const SubstepAnswer& first,
                                     const SubstepAnswer& last) const {
  const double along = substep.velocity_jump < 0.0 ? -1.0 : 1.0, heats = heating(substep);
  const double flux = heats * std::max(0.0, along * start_of(substep, first));
  const double start = flux - substep.flux_before, rise = heats * std::max(0.0, along * last.stress) - flux;
  if (!(start * rise > 0.0)) return 0.0;
  return kCornerShare * std::min(std::abs(rise), std::abs(start) / kLeastStart) * response_ * std::sqrt(substep.length);
}

double SubstepErrors::of_first_order(const Substep& substep, const SubstepAnswer& answer) const {
  const double dt = substep.length * dt_;
  const double off = kHeldShare * std::abs(answer.stress - start_of(substep, answer));
  // T0 may hardly change though the flux does, if the layer goes on heating.
  const double sudden = response_ / dt_ * std::abs(answer.heat - substep.flux_before * dt);
  return largest(substep, answer.stress,
                 {.T0 = kFirstOrderShare * std::max(std::abs(answer.T0 - substep.T0_before), sudden),
                  .heat = heating(substep) * off * dt + elastic_path(substep, &answer, 1),
                  .mean = off * substep.length});
}

// Heat and impulse of second order are compared with those of a straight path of the stress.
double SubstepErrors::of_piece(const Substep& substep, const SubstepAnswer& answer,
                               const SubstepAnswer& first_order) const {
  if ((answer.outcome & kFirstOrder) != 0) return of_first_order(substep, answer);
  const double dt = substep.length * dt_, heats = heating(substep);
  const double straight = 0.5 * heats * dt * std::abs(answer.stress + start_of(substep, answer));
  const double heat = std::abs(answer.heat - straight) + elastic_path(substep, &answer, 1);
  // Backward Euler holds the last flux throughout. Its T0 would differ even if it released the same heat as the
  // second-order step.
  const double apart = answer.T0 - first_order.T0;
  const double with_heat = apart - response_ / dt_ * (answer.heat - first_order.heat);
  return largest(substep, answer.stress,
                 {.T0 = kPieceShare * std::max(std::abs(apart), std::abs(with_heat)),
                  .heat = heat,
                  .mean = heats > 0.0 ? heat / (heats * dt_) : std::abs(answer.stress - start_of(substep, answer))});
}

// Error of T0 of two halves in which slip and flow take over from each other, or friction from the strength of the
// interface. Both may do so too early or too late, and then go on the wrong way alike: T0 is as uncertain as it moves.  [K]
double SubstepErrors::takeover(const Substep& substep, const SubstepAnswer (&halves)[2]) const {
  if (!stops_within_) return 0.0;
  const double damped = substep.of_rest * std::sqrt(substep.of_rest);
  double error = 0.0, T0 = substep.T0_before;
  Sharing before = substep.before;
  for (const SubstepAnswer& half : halves) {
    const Sharing now = half.slip == 0.0                  ? Sharing::kFlow
                        : half.regime == Regime::kCoulomb ? Sharing::kFriction
                                                          : Sharing::kYield;
    if (before != Sharing::kUnknown && now != before) {
      const bool of_slip = now != Sharing::kFlow && before != Sharing::kFlow;
      error += (of_slip ? 1.0 : damped) * std::abs(half.T0 - T0);
    }
    T0 = half.T0;
    before = now;
  }
  return error;
}

double SubstepErrors::of_halves(const Substep& substep, const SubstepAnswer& piece,
                                const SubstepAnswer (&halves)[2]) const {
  const bool second_order = problem_.options.time_integrator == TimeIntegrator::kSdirk2 &&
                            ((piece.outcome | halves[0].outcome | halves[1].outcome) & kFirstOrder) == 0;
  const double share = second_order && sheared_ ? kHeatShare : 1.0;
  const double corner = second_order && sheared_ ? corner_of_flux(substep, halves[0], halves[1]) : 0.0;
  Errors errors{
      .T0 = std::max(std::abs(halves[1].T0 - piece.T0), corner) * (substep.of_rest * std::sqrt(substep.of_rest)),
      .heat = share * std::abs(halves[0].heat + halves[1].heat - piece.heat)};
  if (forced_) {
    const Forcing forcing = forcing_of(inputs_, substep.lane);
    const double half = 0.5 * substep.length * dt_;
    if (!stops_within_)
      errors.heat += problem_.heat_partition *
                     (lost_work(forcing, half, substep.velocity_jump, halves[0].jump_new, halves[0].stress) +
                      lost_work(forcing, half, halves[0].jump_new, halves[1].jump_new, halves[1].stress));
    errors.T0 = std::max(errors.T0, takeover(substep, halves));
    errors.T0 = std::max(errors.T0, jump_as_temperature(substep, piece, halves));
    return largest(substep, halves[1].stress, errors);
  }
  const double path = elastic_path(substep, halves, 2), heats = heating(substep);
  // Missing heat shows in T0 at the end of the step, the more the later it is missing.
  const double rest = substep.length / substep.of_rest;
  errors.T0 = std::max(errors.T0, response_ / dt_ * path / std::sqrt(rest));
  errors.heat += path;
  const double start = start_of(substep, halves[0]);
  const double bend = sheared_ ? std::abs(start - 2.0 * halves[0].stress + halves[1].stress) : 0.0;
  const double ends = share * substep.length * 0.5 * std::abs(halves[1].stress - piece.stress);
  const double curved = goes_on(substep, piece, halves) ? kBendShare * bend : path > 0.0 ? 0.0 : share * 0.25 * bend;
  errors.mean = ends + std::max(path > 0.0 ? path / (heats * dt_) : 0.0, substep.length * curved);
  return largest(substep, halves[1].stress, errors);
}

// Whether the layer flows along one direction, to second order: the path of the stress then bends but has no corner,
// except that it may begin with an elastic part.
bool SubstepErrors::goes_on(const Substep& substep, const SubstepAnswer& piece,
                            const SubstepAnswer (&halves)[2]) const {
  const auto along = [&](const SubstepAnswer& answer) {
    return flows(answer) && (answer.outcome & kFirstOrder) == 0 && answer.stress * substep.stress_before > 0.0;
  };
  return sheared_ && problem_.options.time_integrator == TimeIntegrator::kSdirk2 && along(piece) && along(halves[0]) &&
         along(halves[1]);
}

double SubstepErrors::mean_stress(const Substep& substep, const SubstepAnswer& piece,
                                  const SubstepAnswer (&halves)[2]) const {
  const double mean = 0.5 * (halves[0].mean + halves[1].mean);
  return goes_on(substep, piece, halves) ? mean + (mean - piece.mean) / 3.0 : mean;
}

bool SubstepErrors::flows_on(const Substep& substep, const SubstepAnswer& piece,
                             const SubstepAnswer (&halves)[2]) const {
  const auto on = [&](const SubstepAnswer& answer) {
    return answer.slip == 0.0 && flows(answer) && answer.regime != Regime::kOpen && answer.outcome == 0 &&
           answer.jump_new * substep.velocity_jump > 0.0 && answer.stress * answer.jump_new > 0.0;
  };
  return stops_within_ && !properties_of(problem_.options.soft.flow_law).depends_on_rate && on(piece) &&
         on(halves[0]) && on(halves[1]);
}

// Upper bound of the friction in a substep; infinity where the friction follows a state  [Pa].
double SubstepErrors::most_friction(const Substep& substep, const SubstepAnswer (&halves)[2]) const {
  const auto& [one, two] = halves;
  if (problem_.layout.num_friction_states > 0) return std::numeric_limits<double>::infinity();
  const double pressure = inputs_.pressure[substep.lane];
  const Material soft = at_pressure(problem_.options.soft, pressure);
  const double fastest = std::max({std::abs(substep.velocity_jump), std::abs(one.jump_new), std::abs(two.jump_new),
                                   std::abs(one.slip), std::abs(two.slip)});
  return interface_strength(problem_.interface, soft, pressure, nullptr)
      .friction(std::min({substep.T0_before, one.T0, two.T0}), {fastest, 0.0})
      .stress;
}

double SubstepErrors::impulse_left(const Substep& substep, const SubstepAnswer& piece,
                                   const SubstepAnswer (&halves)[2]) const {
  if (problem_.options.time_integrator != TimeIntegrator::kBackwardEuler) return 0.0;
  const auto slips_on = [&](const SubstepAnswer& answer) {
    return answer.regime != Regime::kOpen && answer.regime != Regime::kStick &&
           answer.jump_new * substep.velocity_jump > 0.0 && answer.outcome == 0;
  };
  if (!slips_on(piece) || !slips_on(halves[0]) || !slips_on(halves[1])) return 0.0;
  const double mean = 0.5 * (halves[0].stress + halves[1].stress);
  double left = substep.yield_before != 0.0 ? (substep.yield_before + halves[0].stress - 2.0 * halves[1].stress) / 6.0
                                            : mean - piece.stress;
  // Where slip takes over from flow within the substep, the stresses do not lie on one path.
  if (const double most = most_friction(substep, halves); std::abs(mean + left) > most)
    left = std::copysign(most, mean) - mean;
  return jump_after(substep, halves[1].jump_new, left) * substep.velocity_jump > 0.0 ? left : 0.0;
}

double SubstepErrors::jump_after(const Substep& substep, double jump_new, double impulse) const {
  return jump_new - forcing_of(inputs_, substep.lane).mobility * substep.length * dt_ * impulse;
}

// The error of the jump after a force-driven substep as a change of T0: a jump that is off stays off, and heats on.
double SubstepErrors::jump_as_temperature(const Substep& substep, const SubstepAnswer& piece,
                                          const SubstepAnswer (&halves)[2]) const {
  const auto& [one, two] = halves;
  const Forcing forcing = forcing_of(inputs_, substep.lane);
  const double half = 0.5 * substep.length * dt_;
  double off = std::abs(two.jump_new - piece.jump_new);
  if (substep.yield_before != 0.0) {
    const double bend = std::abs(substep.yield_before - 2.0 * one.stress + two.stress);
    const double ends = std::abs(two.stress - piece.stress);
    off = std::min(off, 2.0 * half * forcing.mobility * (kFlowBendShare * bend + 0.5 * ends));
  } else if (!stops_within_) {
    off += turning_error(forcing, half, substep.velocity_jump, one.jump_new, substep.stress_before, one.stress) +
           turning_error(forcing, half, one.jump_new, two.jump_new, one.stress, two.stress);
  }
  const double stress = std::max(std::abs(two.stress), std::abs(piece.stress));
  return std::sqrt(std::max(1.0, kJumpTime / dt_)) * problem_.heat_partition * response_ * stress * off;
}

}  // namespace shearbus::physics
