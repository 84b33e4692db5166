// The step of the reference twin (advance_one.hpp) under a tolerance: substeps, each checked against its two halves.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {

namespace {

// Error of the jump after a substep in which the jump changes sign or seems to stop  [m/s]; the reason is in
// solver/around/tolerance.cpp. `before`, `after`: jump at the two ends; `s_before`, `s`: stress before and in the
// substep.
double turning_error(const NodeInputs& in, double dt, double before, double after, double s_before, double s) {
  const double mobility = 1.0 / in.mass_soft + 1.0 / in.mass_hard;
  const double acceleration = std::abs(in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard);
  if (before == 0.0 || before * after > 0.0) return 0.0;
  if (after == 0.0) return acceleration <= mobility * std::abs(s_before) ? 0.0 : std::abs(before);
  const double after_turning = (std::abs(before) + std::abs(after)) / dt;
  return std::abs(before) * (1.0 - after_turning / (after_turning + 2.0 * mobility * std::abs(s)));
}

// Friction work that the answer of a substep leaves out where its slip stops or turns against the far stresses  [J/m2].
double lost_work(const NodeInputs& in, double dt, double before, double after, double s) {
  const double mobility = 1.0 / in.mass_soft + 1.0 / in.mass_hard;
  const double push = dt * (in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard);
  if (before == 0.0 || before * (before + push) >= 0.0) return 0.0;
  const double kinetic = 0.5 * before * before / mobility;
  const double turn = dt * std::abs(before) / (std::abs(before) + std::abs(after));
  return after == 0.0 ? kinetic : std::min(2.0 * kinetic, std::abs(s * before) * turn);
}

bool is_sheared(const ModelOptions& options) {
  return options.strategy == Strategy::kVelocityDriven && options.drive == Drive::kLayerShear;
}

// Error of the heat of the parts of a velocity-driven substep, each of length dt, in which the stress rises elastically
// for a part of the time  [J/m2]; the reason is in solver/around/substep_error.cpp. `flowed`: the layer flowed along
// the jump in the substep before, under the same pressure and jump.
double elastic_path_error(const ModelOptions& options, const NodeInputs& in, double dt, double s_old, bool flowed,
                          const std::vector<NodeOutputs>& part) {
  const double V = in.velocity_jump;
  if (!is_sheared(options) || V == 0.0) return 0.0;
  const double rate = options.soft.shear_modulus * std::abs(V) / options.grid.thickness;
  const double heating = conducted_share(options) * std::abs(V);
  double error = 0.0;
  for (std::size_t i = 0; i < part.size(); ++i) {
    const double before = i == 0 ? s_old : part[0].shear_stress;
    const double size = std::abs(part[i].shear_stress);
    if (part[i].shear_stress * V <= 0.0) continue;
    if (before * part[i].shear_stress < 0.0) {
      const double after_turning = std::max(0.0, dt - std::abs(before) / rate);
      const double impulse = size * after_turning - 0.5 * size * size / rate;
      error += std::abs(part[i].friction_heat - heating * impulse);
    } else if (part[i].regime != Regime::kStick && !(i == 0 ? flowed : part[0].regime != Regime::kStick)) {
      const bool hardens = i == 0 && part.size() > 1;
      const double hardening = hardens ? std::max(0.0, std::abs(part[1].shear_stress) - size) : 0.0;
      const double rise = std::max(0.0, size - std::abs(before) - hardening);
      error += heating * 0.5 * rise * rise / rate;
    }
  }
  return error;
}

// Flux that leaves z = 0 into the bodies  [W/m2].
double flux_at_interface(const ModelOptions& options, const NodeState& state) {
  const double T0 = state.temperature[0];
  const HeatGrid soft(Grid(options.grid), options.grid.far_boundary);
  double flux = options.soft.conductivity * (T0 - state.temperature[1]) / soft.width[0];
  if (options.hard_grid) {
    const HeatGrid hard(Grid(*options.hard_grid), options.hard_grid->far_boundary);
    flux += options.hard.conductivity * (T0 - state.hard_temperature.back()) / hard.width[0];
  }
  return flux;
}

// Scales of the errors of a step of length dt; the largest error of a substep as a fraction of its scale.
struct Scales {
  Scales(const ModelOptions& options, const NodeInputs& in, double step, double B0) : dt(step), response(B0) {
    const double T_melt = options.soft.melting_temperature;
    range = std::max(T_melt - options.initial_temperature, 0.01 * T_melt);
    if (options.strategy == Strategy::kForceDriven) return;
    const double pressure = std::max(in.pressure, 0.0);
    strength = flow_stress(at_pressure(options.soft, pressure), 0.0, pressure, options.initial_temperature) / kSqrt3;
    heating = conducted_share(options) * std::abs(in.velocity_jump);
  }
  double largest(double T0, double heat, double mean, double s_old, double s) const {
    double error = std::max(T0, response / dt * heat) / range;
    if (strength < 0.0) return error;
    const double most = std::max({strength, std::abs(s_old), std::abs(s)});
    if (most > 0.0) error = std::max(error, mean / most);
    if (most > 0.0) error = std::max(error, heat / std::max(heating * most * dt, 0.03 * range * dt / response));
    return error;
  }
  double dt, response, range = 0.0;
  double strength = -1.0;  // shear strength of the cold, unstrained layer; force-driven: none  [Pa]
  double heating = 0.0;    // friction heat per impulse  [m/s]
};

// The stress before a step, which an open interface loses at once.
double start_of(double s_old, const NodeOutputs& out) {
  return out.regime == Regime::kOpen ? 0.0 : s_old;
}

// Error of a whole step by backward Euler, `early` its flux before the step; and of the same step of second order.
double first_order_error(const ModelOptions& options, const NodeInputs& in, const Scales& scales, double early,
                         const NodeState& before, const NodeOutputs& out) {
  const double off = 0.4 * std::abs(out.shear_stress - start_of(before.shear_stress, out));
  const double sudden = scales.response / scales.dt * std::abs(out.friction_heat - early * scales.dt);
  const double moved = std::abs(out.interface_temperature - before.temperature[0]);
  return scales.largest(
      0.15 * std::max(moved, sudden),
      scales.heating * off * scales.dt + elastic_path_error(options, in, scales.dt, before.shear_stress, false, {out}),
      off, before.shear_stress, out.shear_stress);
}
double second_order_error(const ModelOptions& options, const NodeInputs& in, const Scales& scales,
                          const NodeState& before, const NodeOutputs& out, const NodeOutputs& first_order) {
  const double straight =
      0.5 * scales.heating * scales.dt * std::abs(out.shear_stress + start_of(before.shear_stress, out));
  const double heat = std::abs(out.friction_heat - straight) +
                      elastic_path_error(options, in, scales.dt, before.shear_stress, false, {out});
  const double apart = out.interface_temperature - first_order.interface_temperature;
  const double with_heat = apart - scales.response / scales.dt * (out.friction_heat - first_order.friction_heat);
  const double mean = scales.heating > 0.0 ? heat / (scales.heating * scales.dt)
                                           : std::abs(out.shear_stress - start_of(before.shear_stress, out));
  return scales.largest(1.25 * std::max(std::abs(apart), std::abs(with_heat)), heat, mean, before.shear_stress,
                        out.shear_stress);
}

// The relaxation of a velocity-driven node at the start of a step in which its stress falls: the shortest substep, if
// the layer flows in it. Returns whether the state has relaxed.
bool relax(const ModelOptions& options, double shortest_dt, const NodeInputs& in, double s_whole, NodeState& state,
           NodeOutputs& out) {
  const double s_old = state.shear_stress;
  const bool falls = std::abs(s_whole) < std::abs(s_old) || s_whole * s_old < 0.0;
  if (options.strategy == Strategy::kForceDriven || !falls) return false;
  NodeState relaxed = state;
  NodeInputs still = in;
  still.velocity_jump = still.soft_shear_rate = 0.0;
  out = advance_uncontrolled(options, shortest_dt, still, relaxed);
  relaxed.temperature = state.temperature;  // the relaxation takes no time
  relaxed.hard_temperature = state.hard_temperature;
  const bool flows = out.regime != Regime::kStick && out.regime != Regime::kOpen;
  if (!flows || !(std::abs(out.shear_stress) < (1.0 - 1e-9) * std::abs(s_old))) return false;
  state = relaxed;
  return true;
}

// The stress at which a force-driven layer that goes on flowing, with no slip beside it, begins to flow; 0: it does not,
// or the stress depends on more than strain and temperature.
double stress_of_flow_alone(const ModelOptions& options, const NodeInputs& in, const NodeState& state,
                            const std::vector<NodeOutputs>& parts) {
  if (!options.plastic_layer || properties_of(options.soft.flow_law).depends_on_rate) return 0.0;
  const double shear = host_shear(options, in), seen = in.velocity_jump + shear;
  for (const NodeOutputs& out : parts)
    if (out.sliding_velocity != 0.0 || out.regime == Regime::kStick || out.regime == Regime::kOpen || out.answers > 1 ||
        (out.velocity_jump_new + shear) * seen <= 0.0 || out.shear_stress * seen <= 0.0)
      return 0.0;
  const Material soft = at_pressure(options.soft, in.pressure);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < state.plastic_strain.size(); ++i)
    least = std::min(least, flow_stress(soft, state.plastic_strain[i], in.pressure, state.temperature[i]));
  return std::copysign(least / kSqrt3, seen);
}

// Error of T0 of halves in which flow, friction or the strength of the interface take over from each other  [K].
double takeover_error(const ModelOptions& options, double rest, double length, const NodeState& state,
                      const std::vector<NodeOutputs>& half) {
  if (!options.plastic_layer) return 0.0;
  enum { kUnknown, kFlow, kFriction, kYield };
  const auto of_slip = [](Regime regime) { return regime == Regime::kCoulomb ? kFriction : kYield; };
  auto before = state.sticking ? kFlow : state.regime == Regime::kOpen ? kUnknown : of_slip(state.regime);
  double error = 0.0, T0 = state.temperature[0];
  for (const NodeOutputs& out : half) {
    const auto now = out.sliding_velocity == 0.0 ? kFlow : of_slip(out.regime);
    const double damped = now == kFlow || before == kFlow ? std::pow(length / rest, 1.5) : 1.0;
    if (before != kUnknown && now != before) error += damped * std::abs(out.interface_temperature - T0);
    T0 = out.interface_temperature;
    before = now;
  }
  return error;
}

}  // namespace

// Times are fractions of the step. The whole step is tried by backward Euler, then in one piece of second order. Then a
// substep is accepted if its two halves give nearly the same T0, heat and jump as the substep in one piece, else it is
// halved. If the difference is very small the next substep is twice as long.
NodeOutputs advance_controlled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool forced = options.strategy == Strategy::kForceDriven;
  ModelOptions in_one_piece = options;
  in_one_piece.tolerance.reset();
  const double response = heat_of_step(in_one_piece, dt, state, profile_of(state)).B[0];
  const Scales scales(options, inputs, dt, response);
  const double shortest = std::exp2(-std::clamp(std::floor(std::log2(dt / (1e-12 / 64.0))), 1.0, 22.0));
  NodeInputs in = inputs;
  NodeOutputs sum;
  double left = 0.25 * *options.tolerance;
  double length = 1.0;
  bool refined = false;
  int attempts = 0;

  const bool second_order = options.time_integrator == TimeIntegrator::kSdirk2;
  bool both_orders = is_sheared(options) && second_order && !options.sleep && !conducts_by_temperature(options);
  ModelOptions simple = options;
  if (both_orders) simple.time_integrator = TimeIntegrator::kBackwardEuler;
  NodeState once = state;
  NodeOutputs first_order = advance_uncontrolled(simple, dt, in, once);
  const auto accepted = [&](double change) {
    state = once;
    first_order.error_estimate = change;
    if (first_order.shear_stress * first_order.sliding_velocity < 0.0) first_order.sliding_velocity = 0.0;
    return first_order;
  };
  const bool knows_flux = both_orders;
  const double early = both_orders ? flux_at_interface(options, state) : 0.0;
  if (both_orders) {
    const double change = first_order_error(options, in, scales, early, state, first_order);
    if (change <= left) return accepted(change);
  }
  if (NodeOutputs out; relax(options, shortest * dt, in, first_order.shear_stress, state, out)) {
    sum.sliding_velocity = shortest * out.sliding_velocity;
    both_orders = false;
  }
  if (both_orders) {
    once = state;
    const NodeOutputs piece = advance_uncontrolled(options, dt, in, once);
    const double change = piece.first_order ? first_order_error(options, in, scales, early, state, piece)
                                            : second_order_error(options, in, scales, state, piece, first_order);
    first_order = piece;
    if (change <= left) return accepted(change);
  }

  for (double begin = 0.0; begin < 1.0;) {
    NodeState coarse = state, fine = state;
    const double s_before = state.shear_stress;
    const NodeOutputs whole = advance_uncontrolled(options, length * dt, in, coarse);
    std::vector<NodeOutputs> half(2);
    NodeInputs then = in;
    double turning = 0.0, lost = 0.0, s = s_before;
    for (NodeOutputs& out : half) {
      out = advance_uncontrolled(options, 0.5 * length * dt, then, fine);
      if (!forced) continue;
      turning +=
          turning_error(inputs, 0.5 * length * dt, then.velocity_jump, out.velocity_jump_new, s, out.shear_stress);
      lost += conducted_share(options) *
              lost_work(inputs, 0.5 * length * dt, then.velocity_jump, out.velocity_jump_new, out.shear_stress);
      s = out.shear_stress;
      then.velocity_jump = out.velocity_jump_new;
    }
    if (options.plastic_layer) turning = lost = 0.0;  // its step knows where the jump turns and stops
    const bool flowed = begin > 0.0 && state.regime != Regime::kOpen && state.regime != Regime::kStick &&
                        s_before * in.velocity_jump > 0.0;
    const double flow_begins = stress_of_flow_alone(options, in, state, {whole, half[0], half[1]});
    const double path = elastic_path_error(options, in, 0.5 * length * dt, s_before, flowed, half);
    const double rest = 1.0 - begin;
    const bool plain = second_order && !whole.first_order && !half[0].first_order && !half[1].first_order;
    const double share = is_sheared(options) && plain ? 0.5 : 1.0;
    // A flux that starts suddenly and goes on rising: one piece and two halves may agree though both are wrong.
    double corner = 0.0;
    if (is_sheared(options) && plain) {
      const double along = in.velocity_jump < 0.0 ? -1.0 : 1.0;
      const double flux = scales.heating * std::max(0.0, along * start_of(s_before, half[0]));
      const double start = flux - (knows_flux ? flux_at_interface(options, state) : 0.0);
      const double rise = scales.heating * std::max(0.0, along * half[1].shear_stress) - flux;
      if (start * rise > 0.0)
        corner = 0.003 * std::min(std::abs(rise), 4.0 * std::abs(start)) * response * std::sqrt(length);
    }
    double T0 = std::max(std::abs(half[1].interface_temperature - whole.interface_temperature), corner) *
                std::pow(length / rest, 1.5);
    const double heat =
        share * std::abs(half[0].friction_heat + half[1].friction_heat - whole.friction_heat) + path + lost;
    double mean = 0.0;
    if (forced) {
      double off = std::abs(half[1].velocity_jump_new - whole.velocity_jump_new) + turning;
      if (flow_begins != 0.0) {
        const double bend = std::abs(flow_begins - 2.0 * half[0].shear_stress + half[1].shear_stress);
        const double ends = 0.5 * std::abs(half[1].shear_stress - whole.shear_stress);
        off = std::min(off, length * dt * (1.0 / inputs.mass_soft + 1.0 / inputs.mass_hard) * (0.05 * bend + ends));
      }
      T0 = std::max(T0, takeover_error(options, rest, length, state, half));
      T0 = std::max(T0, std::sqrt(std::max(1.0, 1e-6 / dt)) * conducted_share(options) * response *
                            std::max(std::abs(half[1].shear_stress), std::abs(whole.shear_stress)) * off);
    } else {
      T0 = std::max(T0, response / dt * path / std::sqrt(rest));
      const double start = start_of(s_before, half[0]);
      const double bend =
          is_sheared(options) ? std::abs(start - 2.0 * half[0].shear_stress + half[1].shear_stress) : 0.0;
      bool goes_on = is_sheared(options) && plain;  // flows along one direction: the mean stress is extrapolated
      for (const NodeOutputs& out : {whole, half[0], half[1]})
        goes_on = goes_on && out.regime != Regime::kStick && out.shear_stress * s_before > 0.0;
      const double curved = goes_on ? 0.025 * bend : path > 0.0 ? 0.0 : share * 0.25 * bend;
      mean = share * length * 0.5 * std::abs(half[1].shear_stress - whole.shear_stress) +
             std::max(path > 0.0 ? path / (scales.heating * dt) : 0.0, length * curved);
    }
    const double change = scales.largest(T0, heat, mean, s_before, half[1].shear_stress);
    const double by_length = left * std::max(length / rest, 0.05 * length / (begin + length));
    const double allowed = refined ? std::max(by_length, 0.25 * left) : by_length;
    const bool hurries = ++attempts > 1024;
    refined = change > allowed && length > 2.0 * shortest && !hurries;
    if (refined) {
      length *= 0.5;
      continue;
    }
    for (const NodeOutputs& out : half) {
      const NodeOutputs before = sum;
      sum = out;
      sum.shear_stress = forced ? before.shear_stress + 0.5 * length * out.shear_stress : out.shear_stress;
      sum.sliding_velocity = before.sliding_velocity + 0.5 * length * out.sliding_velocity;
      sum.friction_heat = before.friction_heat + out.friction_heat;
      sum.first_order = before.first_order || out.first_order;
      sum.answers = std::max(before.answers, out.answers);
      sum.error_estimate = before.error_estimate;
    }
    if (forced && !second_order) {
      // The errors of backward Euler have one sign in every substep: the mean stress is extrapolated while slip goes on.
      const double shear = host_shear(options, inputs), seen = in.velocity_jump + shear;
      bool on = true;
      for (const NodeOutputs& out : {whole, half[0], half[1]})
        on = on && out.regime != Regime::kOpen && out.regime != Regime::kStick && out.answers == 1 &&
             (out.velocity_jump_new + shear) * seen > 0.0;
      const double of_halves = 0.5 * (half[0].shear_stress + half[1].shear_stress);
      // Simpson's rule, or what two halves and one piece extrapolate to.
      const double more = flow_begins != 0.0
                              ? (flow_begins + 4.0 * half[0].shear_stress + half[1].shear_stress) / 6.0 - of_halves
                              : of_halves - whole.shear_stress;
      const double jump = then.velocity_jump - (1.0 / inputs.mass_soft + 1.0 / inputs.mass_hard) * length * dt * more;
      if (on && (jump + shear) * seen > 0.0) {
        sum.shear_stress += length * more;
        sum.velocity_jump_new = then.velocity_jump = jump;
      }
    }
    sum.error_estimate += change;
    left = change > allowed ? std::max(left, change) : left - change;
    begin += length;
    state = fine;
    if (forced) in.velocity_jump = then.velocity_jump;
    const bool aligned = std::fmod(begin, 2.0 * length) == 0.0;
    const bool grows = hurries ? 1.0 - begin > 64.0 * length : change <= by_length / 6.0;
    if (length < 1.0 && aligned && grows) length *= 2.0;
  }
  if (sum.shear_stress * sum.sliding_velocity < 0.0) sum.sliding_velocity = 0.0;
  state.shear_stress = sum.shear_stress;
  return sum;
}

}  // namespace shearbus::physics::reference
