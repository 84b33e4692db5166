#include "server/physics/solver/force_driven/rigid_slip.hpp"

#include <algorithm>
#include <cmath>

#include "server/physics/solver/problem.hpp"

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

LaneStep open_step(const Forcing& forcing, double dt, double jump_old) {
  const double jump_free = jump_old + dt * forcing.acceleration;
  return {0.0, 0.5 * (jump_old + jump_free), jump_free, 0.0, Regime::kOpen, false, true, false};
}

LaneStep rigid_slip(const StressLimit& strength, const TrialSlip& trial, double heat_partition, double B0, double T_ad,
                    double guess, bool stuck) {
  const FrictionHeating heating = trial.slipping(T_ad, heat_partition * B0);

  // 1. Stick: no slip at the end of the step, if the interface carries the stress that sticking needs. (With the
  // condition [V]mid = 0 instead the jump would oscillate.)
  const double a_stick = trial.stress_stick;
  const bool can_stick = spare_strength(strength, heating, a_stick) >= 0.0;

  // 2. Slip: the stress equals the limit at the temperature and the slip that it causes. Where several answers exist the
  //    node continues as before: a sticking node sticks, a slipping node has the answer with the most slip.
  const bool falls = strength.falls_with_slip();
  SlipSearch slipping{};
  bool unique = !falls && slip_is_unique(strength, heating, a_stick);
  if (!unique) {
    slipping = most_slip_stress(strength, heating, a_stick);
    unique = falls && !slipping.several && !(slipping.found && can_stick);
  }
  bool stick = can_stick;
  bool several = false;
  double a = a_stick;
  if (unique && !can_stick) {
    a = falls ? slipping.stress : slip_stress(strength, heating, a_stick, guess);
  } else if (!unique) {
    several = slipping.several || (slipping.found && can_stick);
    const bool rests = falls && trial.jump_old == 0.0;  // an interface without a jump sticks if it can
    stick = can_stick && (stuck || rests || !slipping.found);
    if (!stick) a = slipping.stress;
  }
  if (!stick) a = below_melting(strength, heating, heat_partition, B0, a);

  // 3. Answer. If the jump changes its sign in the step, a slip against the stress is set to 0: no heat, no work.
  const double slip = stick ? std::max(0.0, 0.5 * trial.jump_old) : heating.slip(a);
  const double flux = heat_partition * (a * slip);
  const double jump_new = stick ? 0.0 : trial.jump_new(a);
  const Regime regime = stick ? Regime::kStick : slip_regime(strength, T_ad + flux * B0, slip);
  return {trial.direction * a, trial.direction * slip, jump_new, flux, regime, stick, unique, several};
}

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
