// The force-driven step, simplified (server/physics/MODEL.md section 6): DLP (61), (65). The host sends far-field
// stresses, the interface law finds the slip. No plastic strain at either scale but that of junctions (section 7).
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "server/physics/interface/friction_laws.hpp"
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
  const JunctionOptions* junctions = problem.options.junctions ? &*problem.options.junctions : nullptr;
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
    StressLimit yield{std::numeric_limits<double>::infinity(), law.yield_strength / kSqrt3, inputs.pressure[lane],
                      &soft};
    yield.effort = inputs.effort;
    const Forcing forcing = forcing_of(inputs, lane);
    const Regime previous = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));
    const LaneStep before{stress_before(layout, inputs, committed, lane),
                          0.0,
                          inputs.velocity_jump[lane],
                          0.0,
                          previous,
                          previous == Regime::kStick,
                          true,
                          false};
    const double junction_strain_old = junctions != nullptr ? committed[layout.junction_strain + lane] : 0.0;
    double junction_strain = junction_strain_old;
    const auto step_from = [&](const Heat& heat, const LaneStep& last) {
      if (yield.pressure <= 0.0) return open_step(forcing, heat.dt, last.jump_new);
      yield.junctions = junctions_of(junctions, junction_strain, heat.dt);
      const TrialSlip trial_slip(forcing, heat.dt, last.jump_new, last.stress);
      const FrictionHeating slip = trial_slip.slipping(0.0, 0.0);
      const Friction friction = FrictionLaws::with(law.friction_law, [&](auto own) {
        return decltype(own)::type::friction(law, yield.pressure, slip.c, slip.b, trial_slip.stress_stick);
      });
      const LaneStep step = rigid_slip(yield, friction, trial_slip, problem.heat_partition, *heat.layer_response(),
                                       T0[lane], std::abs(last.stress), last.sticks);
      junction_strain = yield.junctions.strain(std::abs(step.slip));
      return step;
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
        junction_strain = junction_strain_old;
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
    if (junctions != nullptr) trial[layout.junction_strain + lane] = junction_strain;
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
