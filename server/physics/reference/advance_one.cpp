#include "server/physics/reference/advance_one.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {

double bisect(const std::function<double(double)>& f, double lo, double hi) {
  for (;;) {
    const double mid = 0.5 * (lo + hi);
    if (mid <= lo || mid >= hi) return mid;
    (f(mid) < 0.0 ? lo : hi) = mid;
  }
}

double host_shear(const ModelOptions& options, const NodeInputs& in) {
  return options.plastic_layer ? kSqrt3 * options.grid.thickness * in.soft_plastic_strain_rate : 0.0;
}

double least_slip_of_law(double jump_old, double jump_free) {
  return std::max(0.5 * std::max(0.0, -jump_old), 1e-8 * jump_free);
}

double friction_state_after(const ModelOptions& options, double pressure, double slip, double dt, double state) {
  const InterfaceOptions& law = options.interface;
  const double D = law.slip_length, V0 = law.reference_velocity;
  if (law.friction_law == FrictionLaws::place<PrakashClifton>()) {
    if (pressure <= 0.0) return 0.0;
    return pressure + (state - pressure) * std::exp(-(slip + V0) * dt / D);
  }
  if (law.friction_law == FrictionLaws::place<RateAndState>()) {
    if (pressure <= 0.0) return 0.0;
    const double theta = D / V0 * std::exp(state);
    if (slip < 1e-290) return law.state_evolution == StateEvolution::kSlip ? state : std::log(V0 / D * (theta + dt));
    const double kept = std::exp(-slip * dt / D);
    if (law.state_evolution == StateEvolution::kSlip)  // theta = (D/v) (v theta_old/D)^kept
      return std::log(V0 / slip) + kept * std::log(slip * theta / D);
    return std::log(V0 / D * (theta * kept - D / slip * std::expm1(-slip * dt / D)));
  }
  return state;
}

double friction_of(const ModelOptions& options, double pressure, double T0, double slip, double dt, double state) {
  if (!has_friction(options)) return std::numeric_limits<double>::infinity();
  const InterfaceOptions& law = options.interface;
  const double mu =
      options.strategy == Strategy::kForceDriven ? law.friction_coefficient : *options.friction_coefficient;
  if (law.friction_law == FrictionLaws::place<VelocityWeakening>()) {  // velocity-weakening friction, DLP (3)
    const double fast = law.friction_coefficient_fast;
    return (fast + (mu - fast) * std::exp(-law.velocity_decay * std::max(0.0, slip))) * pressure;
  }
  if (law.friction_law == FrictionLaws::place<ThermalSoftening>()) {
    const double T_melt = at_pressure(options.soft, pressure).melting_temperature;
    const double T_ref = law.friction_reference_temperature;
    const double T = std::clamp((T0 - T_ref) / (T_melt - T_ref), 0.0, 1.0);
    return mu * (1.0 - std::pow(T, law.friction_softening_exponent)) * pressure;
  }
  if (law.friction_law == FrictionLaws::place<Own>()) {  // a law without states
    const shearbus_contact_point point{mu,   pressure, T0, at_pressure(options.soft, pressure).melting_temperature,
                                       slip, nullptr};
    return law.own->limit(&point);
  }
  const double after = friction_state_after(options, pressure, slip, dt, state);
  if (law.friction_law == FrictionLaws::place<PrakashClifton>()) return mu * after;
  if (law.friction_law == FrictionLaws::place<RateAndState>()) {
    if (slip < 1e-290) return 0.0;
    // P a asinh(exp(x)); as printed exp(x) leaves the range of numbers
    const double x =
        std::log(0.5 * slip / law.reference_velocity) + (mu + law.evolution_effect * after) / law.direct_effect;
    return pressure * law.direct_effect * (x > 300.0 ? x + std::log(2.0) : std::asinh(std::exp(x)));
  }
  return mu * pressure;  // constant friction, DLP (65)
}

double interface_yield(const ModelOptions& options, double pressure, double T0, double slip, double dt,
                       double junction_strain) {
  double strength = options.interface.yield_strength;
  if (options.junctions) {
    const Material& m = options.junctions->metal;
    const double strain = junction_strain + dt * slip / (kSqrt3 * options.junctions->height);
    const double hardened = m.yield_strength * std::pow(1.0 + m.hardening_coefficient * strain, m.hardening_exponent);
    strength = options.junctions->contact_fraction * std::min(m.yield_strength_max, hardened);
  }
  return strength / kSqrt3 * softening(options.soft, pressure, T0).g;
}

namespace {

// The interface limit, DLP (65), for friction that does not depend on slip.
struct InterfaceLaw {
  const ModelOptions& options;
  double pressure;
  double friction(double T0) const { return friction_of(options, pressure, T0, 0.0, 0.0, 0.0); }
  double limit(double T0) const {
    return std::min(friction(T0), interface_yield(options, pressure, T0, 0.0, 0.0, 0.0));
  }
};

// SDIRK2 of a node whose contact is open, or which rests, or which slips in one direction from the start to the end of
// the step; s1 and s2 are the stresses of its stages. Returns false, with the state unchanged, for any other step.
bool force_driven_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state,
                         NodeOutputs& out) {
  const InterfaceLaw law{options, in.pressure};
  const double beta_T = conducted_share(options);
  const Profile old = profile_of(state);
  const double acceleration = in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard;
  const double mobility = 1.0 / in.mass_soft + 1.0 / in.mass_hard;
  const double V = in.velocity_jump;
  const double direction = (V != 0.0 ? V : acceleration) < 0.0 ? -1.0 : 1.0;
  const auto jump = [&](double t, double s) { return direction * (V + t * acceleration) - t * s * mobility; };

  NodeState early = state;
  const Heat first = heat_of_step(options, kGamma * dt, state, old);
  double s1 = 0.0, q1 = 0.0, q2 = 0.0, mean = 0.0, slip = 0.0;
  const bool open = in.pressure <= 0.0;
  bool rests = false;
  if (!open) {
    if (jump(kGamma * dt, 0.0) < 0.0 || jump(dt, 0.0) < 0.0) return false;
    const double stick = jump(kGamma * dt, 0.0) / (kGamma * dt * mobility);
    const auto T0 = [&](double s) { return first.T_ad[0] + first.B[0] * beta_T * s * jump(kGamma * dt, s); };
    if (law.limit(T0(stick)) >= stick) {  // the node sticks; if it moved before, backward Euler takes the step
      if (V != 0.0) return false;
      rests = true;
      mean = stick;
    } else {
      s1 = bisect([&](double s) { return s - law.limit(T0(s)); }, 0.0, stick);
      q1 = beta_T * s1 * jump(kGamma * dt, s1);
    }
  }
  heat_up(early, first.T_ad, q1, first.B);
  const Heat second = heat_of_second_stage(options, dt, q1, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) return false;
  if (open) {
    slip = 0.5 * (direction * V + jump(dt, 0.0));
  } else if (!rests) {
    const double stick = jump(dt, 0.0) / (dt * mobility);
    const auto mean_of = [&](double s) { return (1.0 - kGamma) * s1 + kGamma * s; };
    const auto slip_of = [&](double s) { return 0.5 * (direction * V + jump(dt, mean_of(s))); };
    const auto q2_of = [&](double s) { return (beta_T * mean_of(s) * slip_of(s) - (1.0 - kGamma) * q1) / kGamma; };
    const auto spare = [&](double s) { return law.limit(second.T_ad[0] + second.B[0] * q2_of(s)) - s; };
    const double end = (stick - (1.0 - kGamma) * s1) / kGamma;  // stress s2 that makes the jump after the step 0
    if (spare(end) >= 0.0) return false;
    const double s2 = bisect([&](double s) { return -spare(s); }, 0.0, end);
    q2 = q2_of(s2);
    mean = mean_of(s2);
    slip = slip_of(s2);
  }
  Profile T = second.T_ad;
  for (std::size_t i = 0; i < T.rows.size(); ++i) T.rows[i] += q2 * second.B.rows[i];
  if (!in_range(options, in.pressure, old, T)) return false;
  heat_up(state, second.T_ad, q2, second.B);
  out.shear_stress = state.shear_stress = direction * mean;
  out.sliding_velocity = direction * slip;
  out.velocity_jump_new = rests ? 0.0 : direction * jump(dt, mean);
  out.friction_heat = dt * ((1.0 - kGamma) * q1 + kGamma * q2);
  out.interface_temperature = state.temperature[0];
  const double coulomb = law.friction(state.temperature[0]);
  out.regime = state.regime =
      open                                                                                        ? Regime::kOpen
      : rests                                                                                     ? Regime::kStick
      : coulomb > 0.0 && coulomb <= law.limit(state.temperature[0])                               ? Regime::kCoulomb
      : state.temperature[0] >= 0.99 * at_pressure(options.soft, in.pressure).melting_temperature ? Regime::kMelting
                                                                                                  : Regime::kTresca;
  return true;
}

NodeOutputs velocity_driven_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Profile old = profile_of(state);
  NodeState early = state;
  const Heat first = heat_of_step(options, kGamma * dt, state, old);
  const double q1 = one_step(options, kGamma * dt, in, early, first).friction_heat / (kGamma * dt);
  const Heat second = heat_of_second_stage(options, dt, q1, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) {
    NodeOutputs out = one_step(options, dt, in, state, heat_of_step(options, dt, state, old));
    out.first_order = true;
    return out;
  }
  NodeOutputs out = one_step(options, dt, in, state, second);
  out.friction_heat = (1.0 - kGamma) * dt * q1 + kGamma * out.friction_heat;
  return out;
}

NodeOutputs advance_undivided(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state);

// k(T) and c(T) are taken between the temperatures at both ends of the step, which repetitions find.
NodeOutputs advance_varying(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const NodeState before = state;
  const std::vector<double> old = profile_of(before).rows;
  NodeOutputs out;
  std::vector<double> last = old;
  for (int pass = 0; pass <= 8; ++pass) {
    state = before;
    state.coefficients_from = old;
    state.coefficients_to = last;
    out = advance_undivided(options, dt, inputs, state);
    state.coefficients_from.clear();
    state.coefficients_to.clear();
    const std::vector<double> now = profile_of(state).rows;
    double moved = 0.0;
    for (std::size_t i = 0; i < now.size(); ++i) moved = std::max(moved, std::abs(now[i] - last[i]));
    last = now;
    if (pass > 0 && moved <= 1e-6) break;
  }
  return out;
}

}  // namespace

bool conducted_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, const Profile& old,
                      NodeState& state, NodeOutputs& out) {
  const auto solid = [](const NodeState& s) {
    return std::all_of(s.liquid_fraction.begin(), s.liquid_fraction.end(), [](double f) { return f == 0.0; });
  };
  if (options.modes || !solid(state)) return false;
  NodeState early = state;
  const Heat first = heat_of_step(options, kGamma * dt, early, old);
  heat_up(early, first.T_ad, 0.0, first.B);
  const Heat second = heat_of_second_stage(options, dt, 0.0, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) return false;
  heat_up(state, second.T_ad, 0.0, second.B);
  out.interface_temperature = state.temperature[0];
  return true;
}

NodeOutputs advance_uncontrolled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  return conducts_by_temperature(options) ? advance_varying(options, dt, inputs, state)
                                          : advance_undivided(options, dt, inputs, state);
}

namespace {

NodeOutputs advance_undivided(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool sdirk2 = options.time_integrator == TimeIntegrator::kSdirk2 && !inputs.backward_euler;
  if (sdirk2 && only_open_is_second_order(options)) {
    ModelOptions simple = options;
    simple.time_integrator = TimeIntegrator::kBackwardEuler;
    const Profile old = profile_of(state);
    const NodeState before = state;
    NodeOutputs out = advance_undivided(simple, dt, inputs, state);
    const bool open = out.regime == Regime::kOpen;
    NodeState heated = state;
    heated.liquid_fraction = before.liquid_fraction;
    const bool melts = state.liquid_fraction != before.liquid_fraction;
    if (open && !melts && conducted_sdirk2(options, dt, inputs, old, heated, out))
      state = heated;
    else
      out.first_order = !options.modes && out.regime != Regime::kStick;
    if (options.modes && open) out.first_order = false;
    if (options.modes && !open) out.first_order = out.regime != Regime::kStick;
    return out;
  }
  if (options.inertia) return with_inertia(options, dt, inputs, state, sdirk2);
  if (options.strategy == Strategy::kVelocityDriven) {
    if (sdirk2) return velocity_driven_sdirk2(options, dt, inputs, state);
    return one_step(options, dt, inputs, state, heat_of_step(options, dt, state, profile_of(state)));
  }
  if (options.melt_film) return melting_force_driven(options, dt, inputs, state);
  NodeOutputs out;
  if (sdirk2 && force_driven_sdirk2(options, dt, inputs, state, out)) return out;
  out = one_step(options, dt, inputs, state, heat_of_step(options, dt, state, profile_of(state)));
  out.first_order = options.time_integrator == TimeIntegrator::kSdirk2 && out.regime != Regime::kStick;
  return out;
}

}  // namespace

NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  return options.tolerance ? advance_controlled(options, dt, inputs, state)
                           : advance_uncontrolled(options, dt, inputs, state);
}

}  // namespace shearbus::physics::reference
