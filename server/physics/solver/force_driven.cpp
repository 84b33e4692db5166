// The force-driven step, simplified (MODEL.md section 6): DLP (61), (65). The host sends far-field stresses, the
// interface law finds the slip. No plastic strain at either scale.
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {
namespace {

// What the host says of one lane, per unit of time.
struct Forcing {
  double acceleration;  // s_minus/m_minus + s_plus/m_plus, of the jump without friction   [m/s2]
  double mobility;      // 1/m_minus + 1/m_plus                                            [m2/kg]
};

struct LaneStep {
  double stress;    // s, signed                          [Pa]
  double slip;      // [v] = [V]mid, signed               [m/s]
  double jump_new;  // [V] at n+1/2                       [m/s]
  double flux;      // q                                  [W/m2]
  Regime regime;
  bool unique;   // the criterion of MODEL.md section 6 holds
  bool several;  // several answers satisfied the step
};

LaneStep step_lane(const StressLimit& limit, const Forcing& forcing, double heat_partition, double B0, double T_ad,
                   double dt, double jump_old, double guess, Regime previous) {
  // 1. The jump without friction, and what a stress takes from it: DLP (61).
  const double jump_free = jump_old + dt * forcing.acceleration;
  const double per_stress = dt * forcing.mobility;
  if (limit.pressure <= 0.0) {
    return {0.0, 0.5 * (jump_old + jump_free), jump_free, 0.0, Regime::kOpen, true, false};
  }

  // 2. Magnitudes along the trial direction. The slip is [V]mid, the mean of old and new jump: c - b a.
  const double direction = jump_free < 0.0 ? -1.0 : 1.0;
  const FrictionHeating heating{T_ad, heat_partition * B0, 0.5 * (direction * jump_old + std::abs(jump_free)),
                                0.5 * per_stress};

  // 3. Stick: [V]new = 0 at the end of the step (never [V]mid = 0, which rings), if the interface carries that stress.
  const double a_stick = std::abs(jump_free) / per_stress;
  const bool can_stick = spare_strength(limit, heating, a_stick) >= 0.0;

  // 4. Slip: the stress equals the limit at the temperature it makes. Where several answers are possible the node goes
  // on as
  //    before: a sticking one sticks, a slipping one takes the answer with the most slip.
  const bool unique = slip_is_unique(limit, heating, a_stick);
  bool stick = can_stick;
  bool several = false;
  double a = a_stick;
  if (unique) {
    if (!can_stick) a = slip_stress(limit, heating, a_stick, guess);
  } else {
    const SlipSearch slip = most_slip_stress(limit, heating, a_stick);
    several = slip.several || (slip.found && can_stick);
    stick = can_stick && (previous == Regime::kStick || !slip.found);
    if (!stick) a = slip.stress;
  }

  // 5. Answer. Where the jump changes sign within the step the slip along the stress is clipped at 0: no heat, no work.
  const double slip = stick ? std::max(0.0, 0.5 * direction * jump_old) : heating.slip(a);
  const double flux = heat_partition * (a * slip);
  const double jump_new = stick ? 0.0 : jump_free - direction * a * per_stress;
  const Regime regime = stick ? Regime::kStick : slip_regime(limit, T_ad + flux * B0);
  return {direction * a, direction * slip, jump_new, flux, regime, unique, several};
}

struct LaneResult {
  LaneStep step;
  double heat;  // entered the layer  [J/m2]
};

// The whole step in 2^halvings equal substeps; stops at the first one that is not unique unless `accept` says to go on.
template <class Heat>
bool run_substeps(const StressLimit& limit, const Forcing& forcing, const Problem& problem, const Heat& heat,
                  int substeps, bool accept, int lane, double jump_old, double guess, Regime previous,
                  const double* committed, double* temperature, LaneResult& result) {
  const int n = problem.heat_rows;
  for (std::ptrdiff_t i = 0; i < n; ++i) temperature[i * kLanes + lane] = committed[i * kLanes + lane];
  result = {{0.0, 0.0, jump_old, 0.0, previous, true, false}, 0.0};
  for (int j = 0; j < substeps; ++j) {
    conduct_lane(heat, n, lane, temperature);
    const double T_ad = temperature[heat.interface * kLanes + lane];
    const LaneStep step = step_lane(limit, forcing, problem.heat_partition, *heat.layer_response(), T_ad, heat.dt,
                                    result.step.jump_new, guess, result.step.regime);
    if (!step.unique && !accept) return false;
    add_flux_lane(heat, n, lane, step.flux, temperature);
    guess = std::abs(step.stress);
    result.step.stress += step.stress / substeps;
    result.step.slip += step.slip / substeps;
    result.step.jump_new = step.jump_new;
    result.step.regime = step.regime;
    result.step.several |= step.several;
    result.heat += step.flux * heat.dt;
  }
  // Means over a step in which the slip reverses could oppose each other; friction does no negative work.
  if (result.step.stress * result.step.slip < 0.0) result.step.slip = 0.0;
  return true;
}

// `ladder`: the operators of the step and of its halvings.
template <class Heat>
void advance(const Problem& problem, std::span<const Heat> ladder, const TileInputs& inputs, const double* committed,
             double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const InterfaceOptions& law = problem.options.interface;
  const int n = problem.heat_rows;
  const double* T_old = committed + layout.first_temperature();
  double* T = trial + layout.first_temperature();
  const double* T0 = trial + layout.temperature;
  const Heat& heat = ladder.front();

  // 1. Conduction without friction, all lanes: DLP (28-35).
  conduct(heat, n, T_old, T);

  // 2. Stress and slip, lane by lane: DLP (61), (65).
  double flux[kLanes] = {};
  for (int lane = 0; lane < kLanes; ++lane) {
    if (!(inputs.active >> lane & 1u)) continue;
    const Material soft = at_pressure(problem.options.soft, inputs.pressure[lane]);
    const StressLimit limit{law.friction_coefficient * inputs.pressure[lane], law.yield_strength / kSqrt3,
                            inputs.pressure[lane], &soft};
    const Forcing forcing{
        inputs.stress_minus[lane] / inputs.mass_minus[lane] + inputs.stress_plus[lane] / inputs.mass_plus[lane],
        1.0 / inputs.mass_minus[lane] + 1.0 / inputs.mass_plus[lane]};
    const double jump_old = inputs.velocity_jump[lane];
    const double guess = std::abs(committed[layout.shear_stress + lane]);
    const Regime previous = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));

    LaneResult result;
    result.step = step_lane(limit, forcing, problem.heat_partition, *heat.layer_response(), T0[lane], heat.dt, jump_old,
                            guess, previous);
    result.heat = result.step.flux * heat.dt;
    std::uint8_t outcome = 0;
    if (result.step.unique) {
      flux[lane] = result.step.flux;
    } else {
      // 3. Where the step may have several answers: shorter substeps until each has one, or the ladder ends.
      outcome = kSubstepped;
      for (std::size_t k = 1; k < ladder.size(); ++k) {
        const bool last = k + 1 == ladder.size();
        if (run_substeps(limit, forcing, problem, ladder[k], 1 << k, last, lane, jump_old, guess, previous, T_old, T,
                         result)) {
          break;
        }
      }
      if (result.step.several) outcome |= kMultipleRoots;
    }

    outputs.shear_stress[lane] = result.step.stress;
    outputs.sliding_velocity[lane] = result.step.slip;
    outputs.velocity_jump_new[lane] = result.step.jump_new;
    outputs.friction_heat[lane] = result.heat;
    outputs.regime[lane] = result.step.regime;
    outputs.outcome[lane] = outcome;
    trial[layout.shear_stress + lane] = result.step.stress;
    trial[layout.regime + lane] = static_cast<double>(result.step.regime);
  }

  // 4. The friction heat of this step: T = T_ad + q B.
  add_flux(heat, n, flux, T);
  for (int lane = 0; lane < kLanes; ++lane) {
    if (inputs.active >> lane & 1u) outputs.interface_temperature[lane] = T0[lane];
  }
}

}  // namespace

void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs) {
  if (problem.modes) {
    advance(problem, operators.modes(), inputs, committed, trial, outputs);
  } else {
    advance(problem, operators.heats(), inputs, committed, trial, outputs);
  }
}

}  // namespace shearbus::physics
