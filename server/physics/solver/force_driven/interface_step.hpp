// Stress and slip of one lane in a step or substep of a force-driven model whose layer does not flow
// (server/physics/MODEL.md, "Force-driven step", DLP (61), (65), and "Junctions"). The caller conducts the heat.
#pragma once

#include <cmath>
#include <limits>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

class InterfaceStep {
 public:
  InterfaceStep(const Problem& problem, const TileInputs& inputs, const double* committed, const Material& soft,
                int lane)
      : contact(contact_before(problem, committed, lane)),
        problem_(problem),
        soft_(soft),
        pressure_(inputs.pressure[lane]),
        effort_(inputs.effort),
        forcing_(forcing_of(inputs, lane)) {}

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
    LaneStep step = open_step(forcing_, dt, last.jump_new);
    if (pressure_ > 0.0)
      step = rigid_slip(limit_after(last, dt), TrialSlip(forcing_, dt, last.jump_new, last.stress),
                        problem_.heat_partition, B0, T_ad, std::abs(last.stress), last.sticks);
    slip_contact(step, step.slip, dt, T_ad + B0 * step.flux);
    return step;
  }

  // The limit of the stress in a step of length dt after the step `last`.
  StressLimit limit_after(const LaneStep& last, double dt) const {
    StressLimit strength = contact_limit(problem_, soft_, pressure_, dt, contact, effort_);
    if (problem_.layout.num_friction_states > 0)
      strength.least_slip = TrialSlip(forcing_, dt, last.jump_new, last.stress).least_slip();
    return strength;
  }

  // Updates the contact by the slip velocity `slip` of a step. A law that gives no number leaves the step none.
  void slip_contact(LaneStep& step, double slip, double dt, double T0) {
    if (!problem_.options.junctions && problem_.layout.num_friction_states == 0) return;
    if (!advance_contact(contact_limit(problem_, soft_, pressure_, dt, contact, nullptr), slip, T0, contact))
      step.stress = std::numeric_limits<double>::quiet_NaN();
  }

  // Whether `step`, which from() would return, changes suddenly.
  bool changes_suddenly(const LaneStep& last, const LaneStep& step, double dt, double B0, double T_ad) {
    if (pressure_ <= 0.0) return false;
    const TrialSlip trial_slip(forcing_, dt, last.jump_new, last.stress);
    return physics::changes_suddenly(limit_after(last, dt), trial_slip,
                                     trial_slip.slipping(T_ad, problem_.heat_partition * B0), last, step);
  }

  ContactState contact;  // states of the contact before the next step or substep; from() and slip_contact() update them

 private:
  const Problem& problem_;
  const Material& soft_;
  double pressure_;
  SearchEffort* effort_;
  Forcing forcing_;
};

}  // namespace shearbus::physics
