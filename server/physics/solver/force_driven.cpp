// The force-driven step, simplified (server/physics/MODEL.md section 6): DLP (61), (65). The host sends far-field
// stresses, the interface law finds the slip. No plastic strain at either scale.
#include <algorithm>
#include <cmath>
#include <span>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/rigid_slip.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/substeps.hpp"

namespace shearbus::physics {
namespace {

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

  // 1. Conduction without friction, all lanes: DLP (28-35).
  conduct(ladder.front(), n, T_old, T);

  // 2. Stress and slip, lane by lane: DLP (61), (65).
  double flux[kLanes] = {};
  for (int lane = 0; lane < kLanes; ++lane) {
    if (!(inputs.active >> lane & 1u)) continue;
    const Material soft = at_pressure(problem.options.soft, inputs.pressure[lane]);
    const StressLimit limit{law.friction_coefficient * inputs.pressure[lane], law.yield_strength / kSqrt3,
                            inputs.pressure[lane], &soft};
    const Forcing forcing = forcing_of(inputs, lane);
    const Regime previous = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));
    const LaneStep before{committed[layout.shear_stress + lane],
                          0.0,
                          inputs.velocity_jump[lane],
                          0.0,
                          previous,
                          previous == Regime::kStick,
                          true,
                          false};
    const auto step_from = [&](const Heat& heat, const LaneStep& last) {
      if (limit.pressure <= 0.0) return open_step(forcing, heat.dt, last.jump_new);
      return rigid_slip(limit, TrialSlip(forcing, heat.dt, last.jump_new, last.stress), problem.heat_partition,
                        *heat.layer_response(), T0[lane], std::abs(last.stress), last.sticks);
    };

    LaneResult result;
    result.step = step_from(ladder.front(), before);
    result.heat = result.step.flux * ladder.front().dt;
    std::uint8_t outcome = 0;
    if (result.step.unique) {
      flux[lane] = result.step.flux;
    } else {
      // 3. Where the step may have several answers: shorter substeps until each has one, or the ladder ends.
      outcome = kSubstepped;
      for (std::size_t k = 1; k < ladder.size(); ++k) {
        const Heat& heat = ladder[k];
        for (std::ptrdiff_t i = 0; i < n; ++i) T[i * kLanes + lane] = T_old[i * kLanes + lane];
        if (run_substeps(heat, n, 1 << k, k + 1 == ladder.size(), lane, before, T, result,
                         [&](const LaneStep& last) { return step_from(heat, last); })) {
          break;
        }
      }
      if (result.step.several) outcome |= kMultipleRoots;
    }
    set_outputs(result, lane, outputs);
    outputs.outcome[lane] = outcome;
    trial[layout.shear_stress + lane] = result.step.stress;
    trial[layout.regime + lane] = static_cast<double>(result.step.regime);
  }

  // 4. The friction heat of this step: T = T_ad + q B.
  add_flux(ladder.front(), n, flux, T);
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
