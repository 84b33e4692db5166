// Check that the answer of a step exists and is finite.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// A layer with inertia that is sheared for microseconds over cells of nanometres: the last digit of a velocity is a
// stress, and where that is more than a thousandth of what the layer carries at z = 0 the search for the balance of
// momentum may end without one (MODEL.md, "What always holds").
inline bool may_lack_an_answer(const Rig& rig, const Answered& a, int lane) {
  const ModelOptions& options = rig.model.options();
  if (!options.inertia) return false;
  double fastest = std::abs(a.jump_old);
  if (options.strategy == Strategy::kForceDriven) {
    const LeastMasses least = rig.model.least_masses(a.dt);  // the service refuses these
    if (!(rig.inputs.mass_soft[lane] > least.soft && rig.inputs.mass_hard[lane] > least.hard)) return true;
    fastest += a.plastic_drive_size + a.driven_size;
  }
  const Material soft = at_pressure(options.soft, a.pressure);
  const auto& weight = rig.model.grid().weight;
  const double least = *std::min_element(weight.begin(), weight.end());
  const double digit = std::numeric_limits<double>::epsilon() * fastest * soft.shear_modulus * a.dt / least;
  const double T = rig.layer_temperatures(lane).front(), ep = rig.ep_of(rig.trial, 0, lane);
  return digit > 1e-3 * flow_stress(soft, ep, a.pressure, T, 0.0) / kSqrt3;
}

// A node without an answer keeps its state.
inline void require_kept(const Rig& rig, int lane) {
  require(rig.temperatures(rig.trial, lane) == rig.temperatures(rig.committed, lane),
          "a node without an answer changed its temperatures");
}

inline void require_numbers(const Answered& a) {
  require(!(a.outcome & kFailed), "no answer was found");
  require(std::isfinite(a.stress) && std::isfinite(a.slip) && std::isfinite(a.jump_new) && std::isfinite(a.T0) &&
              std::isfinite(a.heat),
          "not a number: s {}, [v] {}, [V] {}, T0 {}, heat {}", a.stress, a.slip, a.jump_new, a.T0, a.heat);
}

}  // namespace shearbus::testing
