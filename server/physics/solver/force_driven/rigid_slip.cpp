#include "server/physics/solver/force_driven/rigid_slip.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "server/physics/solver/force_driven/wide_slip.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

Regime slip_regime(const StressLimit& limit, double T0, double slip) {
  if (limit.at(T0, slip).is_coulomb) return Regime::kCoulomb;
  return T0 >= kMeltingShare * limit.soft->melting_temperature ? Regime::kMelting : Regime::kTresca;
}

LaneStep open_step(const Forcing& forcing, double dt, double jump_old) {
  const double jump_free = jump_old + dt * forcing.acceleration;
  return {0.0, 0.5 * (jump_old + jump_free), jump_free, 0.0, Regime::kOpen, false, true, false};
}

LaneStep rigid_slip(const StressLimit& strength, const TrialSlip& trial, double heat_partition, double B0, double T_ad,
                    double guess, bool stuck) {
  if (const auto quick = quick_slip(strength, trial, heat_partition, B0, T_ad, guess)) return *quick;
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

}  // namespace shearbus::physics
