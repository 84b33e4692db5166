// The step of the reference twin (advance_one.hpp) under a tolerance: substeps, each checked against its two halves.
#include <algorithm>
#include <cmath>

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

// Error of the heat of the halves of a velocity-driven substep, each of length dt, in which the stress rises
// elastically for a part of the time  [J/m2]; the reason is in solver/around/tolerance.cpp.
double elastic_path_error(const ModelOptions& options, const NodeInputs& in, double dt, double s_old,
                          const NodeOutputs (&half)[2]) {
  const double V = in.velocity_jump;
  if (options.strategy == Strategy::kForceDriven || options.drive != Drive::kLayerShear || V == 0.0) return 0.0;
  const double rate = options.soft.shear_modulus * std::abs(V) / options.grid.thickness;
  const double heating = conducted_share(options) * std::abs(V);
  const double size[] = {std::abs(half[0].shear_stress), std::abs(half[1].shear_stress)};
  const bool flows[] = {half[0].regime != Regime::kStick, half[1].regime != Regime::kStick};
  double error = 0.0;
  for (int i : {0, 1}) {
    const double before = i == 0 ? s_old : half[0].shear_stress;
    if (half[i].shear_stress * V <= 0.0) continue;
    if (before * half[i].shear_stress < 0.0) {
      const double after_turning = std::max(0.0, dt - std::abs(before) / rate);
      const double impulse = size[i] * after_turning - 0.5 * size[i] * size[i] / rate;
      error += std::abs(half[i].friction_heat - heating * impulse);
    } else if (flows[i] && (i == 0 || !flows[0])) {
      const double hardening = i == 0 ? std::max(0.0, size[1] - size[0]) : 0.0;
      const double rise = std::max(0.0, size[i] - std::abs(before) - hardening);
      error += heating * 0.5 * rise * rise / rate;
    }
  }
  return error;
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

}  // namespace

// Times are fractions of the step. A substep is accepted if its two halves give nearly the same T0, heat and jump as
// the substep in one piece, else it is halved. If the difference is very small the next substep is twice as long.
NodeOutputs advance_controlled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool forced = options.strategy == Strategy::kForceDriven;
  const double T_melt = options.soft.melting_temperature;
  const double range = std::max(T_melt - options.initial_temperature, 0.01 * T_melt);
  const double response = heat_of_step(options, dt, state, profile_of(state)).B[0];
  const double shortest = std::exp2(-std::clamp(std::floor(std::log2(dt / (1e-12 / 64.0))), 1.0, 22.0));
  NodeInputs in = inputs;
  NodeOutputs sum;
  double left = 0.25 * *options.tolerance;
  double length = 1.0;
  bool refined = false;
  int attempts = 0;
  NodeState once = state;
  const double s_whole = advance_uncontrolled(options, dt, in, once).shear_stress;
  if (NodeOutputs out; relax(options, shortest * dt, in, s_whole, state, out)) {
    sum.sliding_velocity = shortest * out.sliding_velocity;
  }
  for (double begin = 0.0; begin < 1.0;) {
    NodeState coarse = state, fine = state;
    const double s_before = state.shear_stress;
    const NodeOutputs whole = advance_uncontrolled(options, length * dt, in, coarse);
    NodeOutputs half[2];
    NodeInputs then = in;
    double turning = 0.0, s = s_before;
    for (NodeOutputs& out : half) {
      out = advance_uncontrolled(options, 0.5 * length * dt, then, fine);
      if (!forced) continue;
      turning +=
          turning_error(inputs, 0.5 * length * dt, then.velocity_jump, out.velocity_jump_new, s, out.shear_stress);
      s = out.shear_stress;
      then.velocity_jump = out.velocity_jump_new;
    }
    const double path = elastic_path_error(options, in, 0.5 * length * dt, s_before, half);
    const double rest = 1.0 - begin;
    const double T0 =
        std::abs(half[1].interface_temperature - whole.interface_temperature) * std::pow(length / rest, 1.5);
    const double heat =
        response / dt * (std::abs(half[0].friction_heat + half[1].friction_heat - whole.friction_heat) + path);
    const double jump = std::sqrt(std::max(1.0, 1e-6 / dt)) * conducted_share(options) * response *
                        std::max(std::abs(half[1].shear_stress), std::abs(whole.shear_stress)) *
                        (std::abs(half[1].velocity_jump_new - whole.velocity_jump_new) + turning);
    const double change = std::max({T0, heat, jump}) / range;
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
