// Checks the linearised answer of a step against what holds for it in every state (MODEL.md, "Linearised answer").
// Differences of answers (tests/property/physics_linearised.cpp) are a sharper check, but only where the answer has no
// kink nearby.
#pragma once

#include <cmath>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"

namespace shearbus::testing {

// Relative difference that rounding may leave between a derivative and its closed form.
inline constexpr double kTangentDigits = 1e-12;

// Asks for the linearised answer of the rig's last step; leaves the rig as it is.
inline TileOutputs linearised(const Rig& rig) {
  TileOutputs outputs = rig.outputs;
  if (Model::can_linearise(rig.model.options()))
    rig.model.linearise(*rig.operators, rig.inputs, rig.trial.data(), rig.committed.data(), outputs);
  rig.model.predict_melting(*rig.operators, rig.inputs, rig.trial.data(), outputs);
  return outputs;
}

inline void require_time_to_melting(const Rig& rig, const TileOutputs& found, int lane) {
  const double time = found.time_to_melting[lane], T0 = found.interface_temperature[lane];
  const double melting = at_pressure(rig.model.options().soft, rig.inputs.pressure[lane]).melting_temperature;
  require(time >= 0.0, "time to melting {} s", time);
  require((time == 0.0) <= (T0 >= melting * (1.0 - kTangentDigits)), "melting in no time at {} K, {} K below melting",
          T0, melting - T0);
}

inline void require_linearised(const Rig& rig, const TileOutputs& found, int lane) {
  require_time_to_melting(rig, found, lane);
  const ModelOptions& options = rig.model.options();
  if (!Model::can_linearise(options)) return;
  const Answered a = answered(rig, lane, rig.operators->dt());
  const double by_jump = found.stress_per_jump[lane], by_pressure = found.stress_per_pressure[lane];
  require(std::isfinite(by_jump) && std::isfinite(by_pressure), "ds/d[V] {} Pa s/m, ds/dP {} in regime {}", by_jump,
          by_pressure, static_cast<int>(a.regime));
  if (a.regime == Regime::kOpen || a.divided() || (a.outcome & kFailed) != 0) {
    require(by_jump == 0.0 && by_pressure == 0.0, "ds/d[V] {} and ds/dP {} of a step that has none", by_jump,
            by_pressure);
    return;
  }
  if (options.strategy == Strategy::kVelocityDriven) {
    const double elastic = options.soft.shear_modulus * a.dt / options.grid.thickness;
    require(by_jump <= elastic * (1.0 + kTangentDigits), "ds/d[V] {} Pa s/m above the {} of an elastic layer", by_jump,
            elastic);
    if (a.regime != Regime::kCoulomb) return;
    require(by_jump == 0.0 && std::abs(by_pressure) == *options.friction_coefficient,
            "ds/d[V] {}, ds/dP {} of a layer that rubs with {}", by_jump, by_pressure, *options.friction_coefficient);
  } else if (a.regime == Regime::kStick) {
    require(std::abs(by_jump * a.per_stress - 1.0) <= kTangentDigits && by_pressure == 0.0,
            "ds/d[V] {} Pa s/m, ds/dP {} of a contact that sticks with {} m/(s Pa)", by_jump, by_pressure,
            a.per_stress);
  }
}

}  // namespace shearbus::testing
