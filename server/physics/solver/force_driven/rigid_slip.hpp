// The force-driven step of one lane whose layer does not flow (server/physics/MODEL.md, "Force-driven step"): DLP (61),
// (65).
#pragma once

#include <cmath>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// Forces of the host on one lane.
struct Forcing {
  double acceleration;  // acceleration of the jump without friction: s_soft/m_soft + s_hard/m_hard  [m/s2]
  double mobility;      // deceleration of the jump per stress of the interface: 1/m_soft + 1/m_hard  [m2/kg]
};

inline Forcing forcing_of(const TileInputs& inputs, int lane) {
  return {inputs.stress_soft[lane] / inputs.mass_soft[lane] + inputs.stress_hard[lane] / inputs.mass_hard[lane],
          1.0 / inputs.mass_soft[lane] + 1.0 / inputs.mass_hard[lane]};
}

// The velocity jump after a step, DLP (61): its value without friction, less a part in proportion to the stress of the
// interface. The trial direction is that of the jump without friction; stresses are magnitudes along it.
struct TrialSlip {
  TrialSlip(const Forcing& forcing, double dt, double jump_before, double stress_before)
      : jump_free(jump_before + dt * forcing.acceleration), per_stress(dt * forcing.mobility) {
    const double leads = jump_free != 0.0 ? jump_free : stress_before;
    direction = leads < 0.0 ? -1.0 : 1.0;
    jump_old = direction * jump_before;
    stress_stick = std::abs(jump_free) / per_stress;
  }

  // The jump [V]new after the step under the stress magnitude a, signed  [m/s].
  double jump_new(double a) const { return jump_free - direction * a * per_stress; }

  // The least slip velocity for which a friction law with a state is asked, since it may vanish at rest: that at which
  // the slip before a turn of the jump stops, and what is rest  [m/s].
  double least_slip() const {
    const double stopping = -0.5 * jump_old, at_rest = kAtRest * (direction * jump_free);
    return stopping > at_rest ? stopping : at_rest;
  }

  double jump_free;     // jump after the step without friction, signed               [m/s]
  double per_stress;    // reduction of the velocity jump per stress of the interface           [m/(s Pa)]
  double direction;     // sign (+1 or -1) of the jump without friction, or of the old stress if that jump is 0
  double jump_old;      // jump before the step, along the trial direction             [m/s]
  double stress_stick;  // stress at which slip stops at the end of the step          [Pa]

  // Heating of an interface that slips with the velocity c - b a under the stress a: the mean of the jumps before and
  // after the step.
  FrictionHeating slipping(double T_ad, double rise) const {
    return {T_ad, rise, 0.5 * (jump_old + direction * jump_free), 0.5 * per_stress};
  }
};

// The step of a closed contact. `guess`: starting stress of the search  [Pa]. `stuck`: the interface did not slip at
// the end of the last step.
LaneStep rigid_slip(const StressLimit& strength, const TrialSlip& trial, double heat_partition, double B0, double T_ad,
                    double guess, bool stuck);

// The step of an open contact: no stress.
LaneStep open_step(const Forcing& forcing, double dt, double jump_old);

// A step changes suddenly (its outcome says kSudden) where stress or slip change so much that one step may be far from
// the answer of shorter steps (MODEL.md, "Force-driven step"): slip that starts near melting, and slip that turns. The
// jump after the undivided step may then be off by more than this fraction of the larger of the jumps before the step
// and after a step without friction.
inline constexpr double kMostSudden = 0.1;

// Whether jump or stress differs by more than that from the state before the step. A step without this changes suddenly
// only if far stresses turn its slip.
bool moves_far(const TrialSlip& trial, const LaneStep& before, const LaneStep& step);

// `before`, `step`: the state before the step of a closed interface, and its answer.
bool changes_suddenly(const StressLimit& strength, const TrialSlip& trial, const FrictionHeating& heating,
                      const LaneStep& before, const LaneStep& step);

}  // namespace shearbus::physics
