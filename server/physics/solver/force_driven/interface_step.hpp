// Stress and slip of one lane in a step or substep of a force-driven model whose layer does not flow
// (server/physics/MODEL.md, "Force-driven step", DLP (61), (65), and "Junctions"). The caller conducts the heat.
#pragma once

#include <cmath>

#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/force_driven/sudden_change.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// The forces of the host on one lane, with the host's plastic shear if the model has a plastic layer, DLP (64).
inline Forcing forcing_of(const Problem& problem, const TileInputs& inputs, int lane) {
  Forcing forcing = forcing_of(inputs, lane);
  if (problem.options.plastic_layer)
    forcing.plastic_drive = kSqrt3 * problem.options.grid.thickness * inputs.soft_plastic_strain_rate[lane];
  return forcing;
}

class InterfaceStep {
 public:
  InterfaceStep(const Problem& problem, const TileInputs& inputs, const double* committed, const Material& soft,
                int lane)
      : junction_strain(problem.options.junctions ? committed[problem.layout.junction_strain + lane] : 0.0),
        problem_(problem),
        strength_(interface_strength(problem.interface, soft, inputs.pressure[lane], inputs.effort)),
        forcing_(forcing_of(problem, inputs, lane)) {}

  // The state of a lane before the step: its stress, jump, regime, and whether it sticks.
  static LaneStep before(const TileLayout& layout, const TileInputs& inputs, const double* committed, int lane) {
    const Regime previous = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));
    return {
        stress_before(layout, inputs, committed, lane),
        0.0,
        inputs.velocity_jump[lane],
        0.0,
        previous,
        layout.sticking != TileLayout::kAbsent ? committed[layout.sticking + lane] != 0.0 : previous == Regime::kStick,
        true,
        false};
  }

  // The step of length dt after the step `last`. B0: rise of T0 per heat flux; T_ad: T0 without friction in this step.
  LaneStep from(const LaneStep& last, double dt, double B0, double T_ad) {
    if (strength_.pressure <= 0.0) return open_step(forcing_, dt, last.jump_new);
    form_junctions(dt);
    const TrialSlip trial_slip(forcing_, dt, last.jump_new, last.stress);
    const LaneStep step =
        rigid_slip(strength_, trial_slip, problem_.heat_partition, B0, T_ad, std::abs(last.stress), last.sticks);
    junction_strain = strength_.junctions.strain(std::abs(step.slip));
    return step;
  }

  // Whether a step of the lane may change suddenly, by what needs no limit of the stress.
  static bool may_change_suddenly(const TileInputs& inputs, int lane, const LaneStep& last, const LaneStep& step,
                                  double dt) {
    const TrialSlip trial_slip(forcing_of(inputs, lane), dt, last.jump_new, last.stress);
    return trial_slip.jump_old < 0.0 || moves_far(trial_slip, last, step);
  }

  // Whether `step`, which from() would return, changes suddenly.
  bool changes_suddenly(const LaneStep& last, const LaneStep& step, double dt, double B0, double T_ad) {
    if (strength_.pressure <= 0.0) return false;
    form_junctions(dt);
    const TrialSlip trial_slip(forcing_, dt, last.jump_new, last.stress);
    return physics::changes_suddenly(strength_, trial_slip, trial_slip.slipping(T_ad, problem_.heat_partition * B0),
                                     last, step);
  }

  double junction_strain;  // plastic strain ep_a of the junctions before the next step or substep; from() updates it

 private:
  void form_junctions(double dt) {
    strength_.junctions =
        junctions_of(problem_.options.junctions ? &*problem_.options.junctions : nullptr, junction_strain, dt);
  }

  const Problem& problem_;
  StressLimit strength_;
  Forcing forcing_;
};

}  // namespace shearbus::physics
