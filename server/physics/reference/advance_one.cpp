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

double friction_coefficient(const ModelOptions& options, double pressure, double T0, double slip) {
  if (options.strategy == Strategy::kVelocityDriven)
    return options.friction_coefficient.value_or(std::numeric_limits<double>::infinity());
  const InterfaceOptions& law = options.interface;
  const double mu = law.friction_coefficient;
  if (law.friction_law == FrictionLaws::place<VelocityWeakening>()) {  // velocity-weakening friction, DLP (3)
    const double fast = law.friction_coefficient_fast;
    return fast + (mu - fast) * std::exp(-law.velocity_decay * std::max(0.0, slip));
  }
  if (law.friction_law == FrictionLaws::place<ThermalSoftening>()) {
    const double T_melt = at_pressure(options.soft, pressure).melting_temperature;
    const double T_ref = law.friction_reference_temperature;
    const double T = std::clamp((T0 - T_ref) / (T_melt - T_ref), 0.0, 1.0);
    return mu * (1.0 - std::pow(T, law.friction_softening_exponent));
  }
  return mu;  // constant friction, DLP (65)
}

namespace {

NodeOutputs velocity_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state,
                            const Heat& heat) {
  const Material& soft = options.soft;
  const Grid grid(options.grid);
  const double h = options.grid.thickness;
  const double V = in.velocity_jump;
  const bool layer_shear = options.drive == Drive::kLayerShear;
  const double w = layer_shear ? V : h * in.soft_shear_rate;
  const Profile &T_ad = heat.T_ad, &B = heat.B;

  NodeOutputs out;
  out.velocity_jump_new = V;
  if (in.pressure <= 0.0) {
    heat_up(state, T_ad, 0.0, B);
    state.shear_stress = 0.0;
    state.regime = out.regime = Regime::kOpen;
    out.sliding_velocity = V;
    out.interface_temperature = T_ad[0];
    return out;
  }

  // The stress from which the step starts: with INTERFACE_SLIP the yield stress along the jump, if there is a jump and
  // the old stress is not along this jump; otherwise the old stress.
  double s_old = state.shear_stress;
  if (!layer_shear && V != 0.0 && s_old * V <= 0.0) {
    s_old = std::copysign(flow_stress(soft, state.plastic_strain[0], in.pressure, state.temperature[0]) / kSqrt3, V);
  }
  const double trial = s_old + soft.shear_modulus * dt * w / h;
  const double direction = (trial != 0.0 ? trial : V) < 0.0 ? -1.0 : 1.0;
  const double heating = conducted_share(options) * std::max(0.0, direction * V);
  const auto slip = [&](double a) {
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      sum += grid.weight[i] *
             strain_increment(soft, a, in.pressure, T_ad[i] + heating * a * B[i], state.plastic_strain[i], dt);
    }
    return sum;
  };
  const double compliance = kSqrt3 * soft.shear_modulus / h;
  const auto balance = [&](double a) { return a - std::abs(trial) + (a > 0.0 ? compliance * slip(a) : 0.0); };

  // The stress is the least of three limits: the flow of the layer, Y_max g / sqrt(3) at the hottest vertex, and mu P.
  const double flowing = bisect(balance, 0.0, std::abs(trial) * 2.0);
  const auto weakest_g = [&](double a) {
    double g = std::numeric_limits<double>::infinity();
    for (int i = 0; i < grid.num_vertices(); ++i) {
      g = std::min(g, softening(soft, in.pressure, T_ad[i] + heating * a * B[i]).g);
    }
    return g;
  };
  const double ceiling = bisect(
      [&](double a) {
        const double g = weakest_g(a);
        return g > 0.0 ? a - strength_ceiling(soft) * g / kSqrt3 : 1.0;
      },
      0.0, std::abs(trial) * 2.0);
  const bool molten = weakest_g(0.0) <= 0.0;  // a molten vertex carries no stress
  double a = molten ? 0.0 : std::min({flowing, ceiling, std::abs(trial)});
  const double friction = friction_coefficient(options, in.pressure, T_ad[0], V) * in.pressure;
  const bool coulomb = friction < a;
  if (coulomb) a = friction;

  const double flux = heating * a;
  const std::vector<double> ep_old = state.plastic_strain;
  double layer_slip = a > 0.0 ? slip(a) : 0.0;
  const double surplus = std::max(0.0, (std::abs(trial) - a) / compliance - layer_slip);
  int hottest = 0;
  for (int i = 1; i < grid.num_vertices(); ++i) {
    if (T_ad[i] + flux * B[i] > T_ad[hottest] + flux * B[hottest]) hottest = i;
  }
  for (int i = 0; i < grid.num_vertices() && a > 0.0; ++i) {
    state.plastic_strain[i] +=
        strain_increment(soft, a, in.pressure, T_ad[i] + flux * B[i], state.plastic_strain[i], dt);
  }
  double interface_slip = 0.0;
  if (coulomb) {
    interface_slip = surplus;
  } else if (molten || ceiling < flowing) {
    state.plastic_strain[hottest] += surplus / grid.weight[hottest];
    layer_slip += surplus;
  }
  heat_up(state, T_ad, flux, B);
  state.shear_stress = out.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];
  if (options.taylor_quinney_factor) {
    out.friction_heat *= std::accumulate(state.heat_shape.begin(), state.heat_shape.end(), 0.0);
    if (const double all = layer_slip + interface_slip; all > 0.0) {
      for (int i = 0; i < grid.num_vertices(); ++i) {
        state.heat_shape[i] =
            *options.taylor_quinney_factor * grid.weight[i] * (state.plastic_strain[i] - ep_old[i]) / all;
      }
      state.heat_shape[0] += interface_slip / all;
    }
  }

  bool slips = layer_slip > 0.0 || interface_slip > 0.0;
  if (layer_shear) {
    out.sliding_velocity = direction * kSqrt3 * (layer_slip + interface_slip) / dt;
  } else if (V != 0.0 && direction * V > 0.0) {
    out.sliding_velocity = direction * std::max(0.0, direction * (V + w) - kSqrt3 * layer_slip / dt);
    slips = slips || out.sliding_velocity != 0.0;
  }
  out.regime = !slips    ? Regime::kStick
               : coulomb ? Regime::kCoulomb
               : state.temperature[hottest] >= 0.99 * at_pressure(soft, in.pressure).melting_temperature
                   ? Regime::kMelting
                   : Regime::kTresca;
  state.regime = out.regime;
  return out;
}

// The interface limit, DLP (65), for friction that does not depend on slip.
struct InterfaceLaw {
  const ModelOptions& options;
  double pressure;
  double friction(double T0) const { return friction_coefficient(options, pressure, T0, 0.0) * pressure; }
  double limit(double T0) const {
    const double yield = options.interface.yield_strength / kSqrt3 * softening(options.soft, pressure, T0).g;
    return std::min(friction(T0), yield);
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
  const double q1 = velocity_driven(options, kGamma * dt, in, early, first).friction_heat / (kGamma * dt);
  const Heat second = heat_of_second_stage(options, dt, q1, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) {
    NodeOutputs out = velocity_driven(options, dt, in, state, heat_of_step(options, dt, state, old));
    out.first_order = true;
    return out;
  }
  NodeOutputs out = velocity_driven(options, dt, in, state, second);
  out.friction_heat = (1.0 - kGamma) * dt * q1 + kGamma * out.friction_heat;
  return out;
}

NodeOutputs force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const Heat heat = heat_of_step(options, dt, state, profile_of(state));
  const Profile &T_ad = heat.T_ad, &B = heat.B;
  const double beta_T = conducted_share(options);

  // The velocity jump after a step without friction, and its reduction by a unit stress, DLP (61).
  const double jump_free = in.velocity_jump + dt * (in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard);
  const double per_stress = dt * (1.0 / in.mass_soft + 1.0 / in.mass_hard);
  const double direction = jump_free < 0.0 ? -1.0 : 1.0;
  const auto jump_new = [&](double a) { return jump_free - direction * a * per_stress; };
  const auto slip = [&](double a) { return std::max(0.0, direction * 0.5 * (in.velocity_jump + jump_new(a))); };
  const auto T0 = [&](double a) { return T_ad[0] + B[0] * beta_T * a * slip(a); };
  // The friction branch of DLP (65), with the friction law of the options.
  const InterfaceOptions& law = options.interface;
  const bool weakens = law.friction_law == FrictionLaws::place<VelocityWeakening>();
  const auto coulomb = [&](double a) {
    return friction_coefficient(options, in.pressure, T0(a), slip(a)) * in.pressure;
  };
  // Junctions, DLP (49-54): their strain ep_a grows with the slip.
  const auto junction_strain = [&](double v) {
    return options.junctions ? state.junction_strain + dt * v / (kSqrt3 * options.junctions->height) : 0.0;
  };
  const auto strength = [&](double v) {
    if (!options.junctions) return law.yield_strength;
    const Material& m = options.junctions->metal;
    return options.junctions->contact_fraction *
           std::min(
               m.yield_strength_max,
               m.yield_strength * std::pow(1.0 + m.hardening_coefficient * junction_strain(v), m.hardening_exponent));
  };
  const auto yield = [&](double T, double v) { return strength(v) / kSqrt3 * softening(soft, in.pressure, T).g; };
  const auto spare = [&](double a) { return std::min(coulomb(a), yield(T0(a), slip(a))) - a; };

  NodeOutputs out;
  double a = 0.0;
  if (in.pressure <= 0.0) {
    out.regime = Regime::kOpen;
    out.sliding_velocity = 0.5 * (in.velocity_jump + jump_free);
    out.velocity_jump_new = jump_free;
  } else {
    // Finds all roots: the stresses a between 0 and the sticking stress at which the interface carries the stress a,
    // neither more nor less.
    const double a_stick = std::abs(jump_free) / per_stress;
    const double most = yield(T_ad[0], slip(0.0));
    const double end = std::min(a_stick, weakens ? most : std::min(coulomb(0.0), most));
    std::vector<double> slips;
    double before = 0.0;
    for (int i = 1; i <= kScan; ++i) {
      const double at = end * i / kScan;
      if ((spare(before) > 0.0) != (spare(at) > 0.0)) {
        const double sign = spare(before) > 0.0 ? -1.0 : 1.0;
        slips.push_back(bisect([&](double x) { return sign * spare(x); }, before, at));
      }
      before = at;
    }
    const bool can_stick = spare(a_stick) >= 0.0;
    // If no root was found and the interface cannot stick, the answer is the largest stress of the scan.
    if (slips.empty() && !can_stick) slips.push_back(end);
    out.answers = static_cast<int>(slips.size()) + (can_stick ? 1 : 0);
    const bool rests = state.regime == Regime::kStick || (weakens && in.velocity_jump == 0.0);
    const bool stick = can_stick && (rests || slips.empty());
    a = stick ? a_stick : slips.empty() ? end : slips.front();
    out.sliding_velocity = direction * slip(a);
    out.velocity_jump_new = stick ? 0.0 : jump_new(a);
    const bool coulomb_acts = coulomb(a) > 0.0 && coulomb(a) <= yield(T0(a), slip(a));
    out.regime = stick                                                                ? Regime::kStick
                 : coulomb_acts                                                       ? Regime::kCoulomb
                 : T0(a) >= 0.99 * at_pressure(soft, in.pressure).melting_temperature ? Regime::kMelting
                                                                                      : Regime::kTresca;
    // A step changes suddenly where heat lowers the limit of slip that was slower or colder before, or where the slip
    // turns: two opposite stresses act then, of friction as in the step or after half the heat of the slip before.
    const auto limit = [&](double T) {
      return std::min(friction_coefficient(options, in.pressure, T, slip(a)) * in.pressure, yield(T, slip(a)));
    };
    const double allowed = 0.1 * std::max(std::abs(in.velocity_jump), std::abs(jump_free));
    const double cold = limit(T_ad[0]);
    const double moved = std::max(std::abs(out.velocity_jump_new - in.velocity_jump),
                                  per_stress * std::abs(a - std::abs(state.shear_stress)));
    out.sudden = per_stress * (std::min(cold, a_stick) - a) > allowed && moved > allowed;
    if (in.velocity_jump * jump_free < 0.0) {
      const double size = std::abs(in.velocity_jump), far = size + std::abs(jump_free);
      const double half_heated = limit(T_ad[0] + B[0] * beta_T * a * 0.5 * size);
      for (const double friction : {stick ? cold : a, std::min(stick ? cold : a, half_heated)}) {
        const double slows = far + per_stress * friction, speeds_up = far - per_stress * friction;
        const double turned = slows > size && speeds_up > 0.0 ? (1.0 - size / slows) * speeds_up : -1.0;
        out.sudden = out.sudden || (turned >= 0.0 && std::abs(turned - direction * out.velocity_jump_new) > allowed);
      }
    }
  }
  const double flux = in.pressure <= 0.0 ? 0.0 : beta_T * a * slip(a);
  if (in.pressure > 0.0) state.junction_strain = junction_strain(slip(a));
  heat_up(state, T_ad, flux, B);
  out.shear_stress = state.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];
  state.regime = out.regime;
  return out;
}

}  // namespace

NodeOutputs advance_uncontrolled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool sdirk2 = options.time_integrator == TimeIntegrator::kSdirk2 && !inputs.backward_euler;
  if (options.inertia) return with_inertia(options, dt, inputs, state, sdirk2);
  if (options.strategy == Strategy::kVelocityDriven) {
    if (sdirk2) return velocity_driven_sdirk2(options, dt, inputs, state);
    return velocity_driven(options, dt, inputs, state, heat_of_step(options, dt, state, profile_of(state)));
  }
  if (options.melt_film) return melting_force_driven(options, dt, inputs, state);
  if (options.plastic_layer) return flowing_force_driven(options, dt, inputs, state);
  NodeOutputs out;
  if (sdirk2 && force_driven_sdirk2(options, dt, inputs, state, out)) return out;
  out = force_driven(options, dt, inputs, state);
  out.first_order = options.time_integrator == TimeIntegrator::kSdirk2 && out.regime != Regime::kStick;
  return out;
}

NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  return options.tolerance ? advance_controlled(options, dt, inputs, state)
                           : advance_uncontrolled(options, dt, inputs, state);
}

}  // namespace shearbus::physics::reference
