#include "tests/campaign/controls.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "server/physics/reference/parts.hpp"
#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, invariants of tests/support

namespace {

constexpr double kPressure = 11.2e9;  // pressure on the interface in all controls  [Pa]

// A wrong solver. It computes a step of lane 0 in place of the rig's model.
using Solver = std::function<void(Rig&, double dt)>;

struct ControlCase {
  std::string name, what;
  ModelOptions options;
  double dt = 1e-9;  // step length  [s]
  int steps = 0;
  double jump = 0.0;           // velocity jump before the first step  [m/s]
  bool pulse = false;          // true: the velocity jump is 0 from the second step on
  bool closed_loop = false;    // true: each step starts with the final velocity jump of the step before
  double stress_soft = 0.0;    // far stress of the soft body in the first step  [Pa]
  double stress_growth = 0.0;  // growth of the far stress per step, relative to stress_soft
  double mass = 1.0;           // mass per area of each body's half zone  [kg/m2]
  double start = 300.0;        // initial temperature  [K]
  bool must_ring = false;
  // Returns the quantity that is watched for ringing. `size` is its scale; changes above 1e-3 of the scale count.
  std::function<double(const Answered&)> ringing_of;
  double size = 1.0;
  Solver solver;
};

// ---- Writing the answer of a wrong solver into the rig ----

struct WrongAnswer {
  double stress = 0.0, slip = 0.0, jump_new = 0.0, flux = 0.0;
  Regime regime = Regime::kTresca;
};

// Writes a wrong solver's answer into the rig's state and outputs. rig.trial must hold the state before the step,
// rig.committed the temperatures after it.
void finish(Rig& rig, double dt, const WrongAnswer& answer) {
  const TileLayout& layout = rig.model.layout();
  rig.committed[layout.shear_stress] = answer.stress;
  rig.committed[layout.regime] = static_cast<double>(answer.regime);
  rig.outputs.shear_stress[0] = answer.stress;
  rig.outputs.sliding_velocity[0] = answer.slip;
  rig.outputs.velocity_jump_new[0] = answer.jump_new;
  rig.outputs.interface_temperature[0] = rig.T(0);
  rig.outputs.friction_heat[0] = answer.flux * dt;
  rig.outputs.regime[0] = answer.regime;
  rig.outputs.outcome[0] = 0;
}

// Copies the state before the step to rig.trial; then conducts heat for dt in rig.committed, without a flux at the
// interface.
const HeatOperator& begin(Rig& rig, double dt) {
  if (!rig.operators || rig.operators->dt() != dt) rig.operators = rig.model.operators(dt);
  rig.trial = rig.committed;
  conduct(rig.operators->heat(), rig.heat_grid().num_vertices(),
          rig.trial.data() + rig.model.layout().first_temperature(),
          rig.committed.data() + rig.model.layout().first_temperature());
  return rig.operators->heat();
}

void heat_up(Rig& rig, const HeatOperator& heat, double flux) {
  add_flux_lane(heat, rig.heat_grid().num_vertices(), 0, flux,
                rig.committed.data() + rig.model.layout().first_temperature());
}

double limit_at(const Rig& rig, double T0) {
  const ModelOptions& o = rig.model.options();
  return std::min(o.interface.friction_coefficient * kPressure,
                  o.interface.yield_strength * softening(o.soft, kPressure, T0).g / kSqrt3);
}

struct Body {  // momentum balance of lane 0, DLP (61): [V]new = [V]old + driven - per_stress * s
  double driven, per_stress;
};
Body body_of(const Rig& rig, double dt) {
  const TileInputs& in = rig.inputs;
  return {dt * in.stress_soft[0] / in.mass_soft[0], dt * (1 / in.mass_soft[0] + 1 / in.mass_hard[0])};
}

// ---- Wrong solvers ----

// Sticks so that the mean velocity jump over the step is 0, [V]mid = 0, as printed in the paper. The jump after the
// step is then -[V]old, but must be 0 while the interface sticks.
void midpoint_stick(Rig& rig, double dt) {
  begin(rig, dt);
  const Body body = body_of(rig, dt);
  const double jump = rig.inputs.velocity_jump[0];
  finish(rig, dt, {(2.0 * jump + body.driven) / body.per_stress, 0.0, -jump, 0.0, Regime::kStick});
}

// Solves the stress balance DLP (56) by the plain secant method, without a bracket. The last iterate is the answer even
// if it has not converged.
void plain_secant(Rig& rig, double dt) {
  const HeatOperator& heat = begin(rig, dt);
  const ModelOptions& o = rig.model.options();
  const Grid& grid = rig.model.grid();
  const double jump = rig.inputs.velocity_jump[0];
  const double s_old = rig.trial[rig.model.layout().shear_stress];
  const double share = heat_partition(o.soft, o.hard);
  const auto strain_of = [&](int i, double s) {
    const double T = rig.T(i) + share * std::max(0.0, s * jump) * heat.layer_response()[i];
    // Above melting the strain of DLP (48) as printed is undefined; a large value stands for it.
    if (T >= o.soft.melting_temperature) return s > 0.0 ? 1e6 : 0.0;
    return reference::strain_increment(o.soft, std::max(0.0, s), kPressure, T, rig.ep(i), dt);
  };
  const auto flow = [&](double s) {
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) sum += grid.weight[static_cast<std::size_t>(i)] * strain_of(i, s);
    return sum;
  };
  const double h = o.grid.thickness;
  const auto balance = [&](double s) {
    return h * (s - s_old) / dt + kSqrt3 * o.soft.shear_modulus * flow(s) / dt - o.soft.shear_modulus * jump;
  };
  double s_last = s_old, s = s_old + 0.01 * o.soft.shear_modulus * dt * jump / h;
  double F_last = balance(s_last), F = balance(s);
  for (int iteration = 0; iteration < 50 && F != F_last && std::abs(s - s_last) > 1e-10 * std::abs(s); ++iteration) {
    const double next = s - F * (s - s_last) / (F - F_last);
    s_last = s;
    F_last = F;
    s = next;
    F = balance(s);
  }
  WrongAnswer answer{.stress = s, .jump_new = jump, .flux = share * std::max(0.0, s * jump)};
  for (int i = 0; i < grid.num_vertices(); ++i) {
    const double dep = strain_of(i, s);
    rig.committed[rig.model.layout().plastic_strain + static_cast<std::size_t>(i) * kLanes] += dep;
    answer.slip += kSqrt3 * grid.weight[static_cast<std::size_t>(i)] * dep / dt;
  }
  heat_up(rig, heat, answer.flux);
  finish(rig, dt, answer);
}

// Computes the stress limit of the interface with T0 before the step. The correct model uses T0 after the step.
void explicit_flux(Rig& rig, double dt) {
  const double T_old = rig.T(0);
  const HeatOperator& heat = begin(rig, dt);
  const Body body = body_of(rig, dt);
  const double jump = rig.inputs.velocity_jump[0];
  const double s = limit_at(rig, T_old);
  WrongAnswer answer{.stress = s, .jump_new = jump + body.driven - s * body.per_stress};
  answer.slip = std::max(0.0, 0.5 * (jump + answer.jump_new));
  answer.flux = rig.conducted_share() * s * answer.slip;
  heat_up(rig, heat, answer.flux);
  finish(rig, dt, answer);
}

// Solves the slip balance DLP (64) with the layer's flow in the previous step. The flow in the present step is computed
// afterwards, from the stress found.
Solver lagged_strain() {
  return [flow = 0.0](Rig& rig, double dt) mutable {
    const HeatOperator& heat = begin(rig, dt);
    const ModelOptions& o = rig.model.options();
    const Grid& grid = rig.model.grid();
    const Body body = body_of(rig, dt);
    const double jump = rig.inputs.velocity_jump[0];
    const double limit = limit_at(rig, rig.T(0));
    const double sticking = (jump + body.driven - kSqrt3 * flow) / body.per_stress;
    const bool sticks = std::abs(sticking) <= limit;
    WrongAnswer answer{.stress = std::clamp(sticking, -limit, limit)};
    answer.jump_new = jump + body.driven - answer.stress * body.per_stress;
    answer.slip = sticks ? 0.0 : 0.5 * (jump + answer.jump_new) - kSqrt3 * flow;
    answer.flux = rig.conducted_share() * std::max(0.0, answer.stress * answer.slip);
    heat_up(rig, heat, answer.flux);
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      const double dep =
          reference::strain_increment(o.soft, std::abs(answer.stress), kPressure, rig.T(i), rig.ep(i), dt);
      rig.committed[rig.model.layout().plastic_strain + static_cast<std::size_t>(i) * kLanes] += dep;
      sum += grid.weight[static_cast<std::size_t>(i)] * dep;
    }
    flow = std::copysign(sum / dt, answer.stress);
    finish(rig, dt, answer);
    rig.committed[rig.model.layout().sticking] = sticks ? 1.0 : 0.0;
  };
}

// Tries an elastic step without friction heat. Only if a vertex would yield in this step, the correct model makes the
// step.
void elastic_first(Rig& rig, double dt) {
  begin(rig, dt);
  const ModelOptions& o = rig.model.options();
  const double jump = rig.inputs.velocity_jump[0];
  const double trial = rig.trial[rig.model.layout().shear_stress] + o.soft.shear_modulus * dt * jump / o.grid.thickness;
  bool yields = false;
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) {
    yields = yields || std::abs(trial) * kSqrt3 > flow_stress(o.soft, rig.ep(i), kPressure, rig.T(i));
  }
  if (!yields) return finish(rig, dt, {trial, 0.0, jump, 0.0, Regime::kStick});
  rig.committed = rig.trial;
  rig.step(dt);
}

// Conducts heat by the Crank-Nicolson scheme: half a step of forward Euler, then half a step of backward Euler. The
// forward half repeats the temperature change in the backward half of the previous step, corrected for the new flux.
Solver crank_nicolson() {
  return [midway = std::vector<double>(), last_flux = 0.0](Rig& rig, double dt) mutable {
    const HeatGrid& grid = rig.heat_grid();
    const ModelOptions& o = rig.model.options();
    const Body body = body_of(rig, dt);
    const double jump = rig.inputs.velocity_jump[0];
    WrongAnswer answer{.regime = Regime::kStick};
    if (jump != 0.0) {
      const double s = o.interface.friction_coefficient * kPressure;
      answer = {.stress = s, .jump_new = jump + body.driven - s * body.per_stress, .regime = Regime::kCoulomb};
      answer.slip = 0.5 * (jump + answer.jump_new);
      answer.flux = rig.conducted_share() * s * answer.slip;
    }
    const HeatOperator half(grid, o.soft, o.hard, 0.5 * dt);
    if (!rig.operators) rig.operators = rig.model.operators(dt);
    rig.trial = rig.committed;
    const std::size_t rows = static_cast<std::size_t>(grid.num_vertices()) * kLanes;
    midway.resize(rows, 300.0);  // first call only: the field before the first step, uniform at 300 K
    for (std::size_t i = 0; i < rows; ++i) midway[i] = 2.0 * rig.committed[i] - midway[i];
    midway[0] += 0.5 * dt * (answer.flux - last_flux) / grid.capacity(0, o.soft, o.hard);
    last_flux = answer.flux;
    conduct(half, grid.num_vertices(), midway.data(), rig.committed.data());
    heat_up(rig, half, answer.flux);
    finish(rig, dt, answer);
  };
}

// ---- Running the controls and checking their steps ----

ControlOutcome outcome_of(const ControlCase& control, bool model) {
  ControlOutcome outcome;
  outcome.name = control.name;
  outcome.what = control.what;
  Rig rig(control.options, 1);
  double T[kLanes];
  std::fill_n(T, kLanes, control.start);
  rig.start(T);
  rig.set_all(control.jump, kPressure);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = control.mass;
  }
  Ringing ringing;
  Figures figures;
  double last[3] = {};
  for (; outcome.steps < control.steps; ++outcome.steps) {
    if (control.closed_loop && outcome.steps > 0) rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
    if (control.pulse && outcome.steps > 0) rig.inputs.velocity_jump[0] = 0.0;
    rig.inputs.stress_soft[0] = control.stress_soft * (1.0 + control.stress_growth * outcome.steps);
    if (model) {
      rig.step(control.dt);
    } else {
      control.solver(rig, control.dt);
    }
    try {
      require_invariants(rig, 0, control.dt, figures);
    } catch (const Broken& broken) {
      if (outcome.broken++ == 0) outcome.first = fmt::format("step {}: {}", outcome.steps, broken.what());
    }
    const Answered a = answered(rig, 0, control.dt);
    outcome.hottest = std::max(outcome.hottest, a.T0);
    const double value = control.ringing_of(a);
    ringing.see(value, control.size);
    last[0] = last[1];
    last[1] = last[2];
    last[2] = value;
    if (ringing.rings() && !outcome.rings) {
      outcome.rings = true;
      outcome.factor = (last[2] - last[1]) / (last[1] - last[0]);
    }
  }
  return outcome;
}

std::vector<ControlCase> control_cases() {
  const ModelOptions velocity = graded(paper_options(Strategy::kVelocityDriven));
  const ModelOptions force = graded(paper_options(Strategy::kForceDriven));
  ModelOptions coulomb = force;
  coulomb.interface.friction_coefficient = 0.005;
  ModelOptions flowing = force;
  flowing.plastic_layer = true;
  flowing.interface.yield_strength = 600e6;
  flowing.grid.thickness = 1e-8;
  const auto stress = [](const Answered& a) { return a.stress; };
  return {
      {.name = "midpoint_stick",
       .what = "sticks by [V]mid = 0, as printed",
       .options = force,
       .steps = 100,
       .jump = 1.0,
       .closed_loop = true,
       .mass = 0.05,
       .must_ring = true,
       .ringing_of = [](const Answered& a) { return a.jump_new; },
       .solver = midpoint_stick},
      {.name = "plain_secant",
       .what = "secant method without a bracket on (56)",
       .options = velocity,
       .steps = 1000,
       .jump = 1000.0,
       .ringing_of = stress,
       .size = 1e8,
       .solver = plain_secant},
      {.name = "explicit_flux",
       .what = "friction at the temperature before the step, alpha dt/dz^2 = 5e4 at z = 0",
       .options = force,
       .dt = 1e-7,
       .steps = 50,
       .jump = 1000.0,
       .mass = 10.0,
       .ringing_of = stress,
       .size = 1e8,
       .solver = explicit_flux},
      {.name = "lagged_strain",
       .what = "the layer's flow of the last step in (64)",
       .options = flowing,
       .steps = 60,
       .closed_loop = true,
       .stress_soft = 450e6,
       .stress_growth = 0.01,
       .mass = 0.01,
       .must_ring = true,
       .ringing_of = stress,
       .size = 1e8,
       .solver = lagged_strain()},
      {.name = "elastic_first",
       .what = "an elastic step without heat is tried first",
       .options = velocity,
       .dt = 2.5e-10,
       .steps = 4000,
       .jump = 100.0,
       .start = 1215.0,
       .must_ring = true,
       .ringing_of = stress,
       .size = 1e8,
       .solver = elastic_first},
      {.name = "crank_nicolson",
       .what = "heat by Crank and Nicolson, after one step of friction",
       .options = coulomb,
       .dt = 1e-8,
       .steps = 40,
       .jump = 100.0,
       .pulse = true,
       .mass = 1e6,
       .must_ring = true,
       .ringing_of = [](const Answered& a) { return a.T0; },
       .solver = crank_nicolson()},
  };
}

}  // namespace

std::vector<Control> run_controls() {
  std::vector<Control> controls;
  for (const ControlCase& control : control_cases()) {
    controls.push_back({outcome_of(control, false), outcome_of(control, true), control.must_ring});
  }
  return controls;
}

}  // namespace shearbus::study::stability
