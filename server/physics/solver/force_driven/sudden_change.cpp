#include "server/physics/solver/force_driven/sudden_change.hpp"

#include <algorithm>
#include <cmath>

#include "server/physics/solver/force_driven/rigid_slip.hpp"

namespace shearbus::physics {
namespace {

// The jump after a step in which forces that alone change it by `far` stop and turn the jump `size` >= 0 under the
// constant friction that alone changes it by `friction`. Where the slip does not turn within the step the result is
// `answer`. All are positive along the jump after the step.
double jump_of_turn(double size, double far, double friction, double answer) {
  if (far <= friction || size >= far + friction) return answer;
  return (1.0 - size / (far + friction)) * (far - friction);
}

double allowed_change(const TrialSlip& trial) {
  return kMostSudden * std::max(std::abs(trial.jump_free), std::abs(trial.jump_old));
}

}  // namespace

bool moves_far(const TrialSlip& trial, const LaneStep& before, const LaneStep& step) {
  return std::max(std::abs(step.jump_new - trial.direction * trial.jump_old),
                  trial.per_stress * std::abs(std::abs(step.stress) - std::abs(before.stress))) > allowed_change(trial);
}

bool changes_suddenly(const StressLimit& strength, const TrialSlip& trial, const FrictionHeating& heating,
                      const LaneStep& before, const LaneStep& step) {
  if (step.sticks && trial.jump_old >= 0.0) return false;  // it stops under less than the limit
  const bool far = moves_far(trial, before, step);
  if (!far && trial.jump_old >= 0.0) return false;
  const double free = std::abs(trial.jump_free), size = std::abs(trial.jump_old);
  const double allowed = allowed_change(trial), per_stress = trial.per_stress;
  const double a = std::abs(step.stress), slip = std::abs(step.slip);
  const double cold = strength.at(heating.T_ad, slip).stress;  // the limit without the heat of the step

  // Slip that heats: the stress of the whole step is that of its end, though the interface is cold at first, unless it
  // slipped as fast and as hot in the step before.
  const double fall = per_stress * (std::min(cold, trial.stress_stick) - a);
  if (trial.jump_old >= 0.0) return fall > allowed;

  // Slip that far stresses turn: one stress acts in the whole step, also where the slip still has the other sign. The
  // friction is that of the step, or that after half the heat of the slip before it has turned.
  const double answer = trial.direction * step.jump_new;
  const double held = step.sticks ? cold : a;
  const double heated = std::min(held, strength.at(heating.T_ad + heating.rise * (a * (0.5 * size)), slip).stress);
  const auto off = [&](double friction) {
    return std::abs(jump_of_turn(size, free + size, per_stress * friction, answer) - answer);
  };
  return (far && fall > allowed) || std::max(off(held), off(heated)) > allowed;
}

}  // namespace shearbus::physics
