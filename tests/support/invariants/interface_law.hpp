// An invariant of server/physics/MODEL.md, "What always holds": the interface slips only at its stress limit. This file
// also checks the momentum balance of the bodies, DLP (61).
#pragma once

#include <algorithm>
#include <cmath>

#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/heat_of_work.hpp"
#include "tests/support/invariants/interface_limits.hpp"

namespace shearbus::testing {

// Requires that the velocity jump satisfies the momentum balance of the bodies, DLP (61), and that the stress is within
// the limits of the interface.
inline void require_interface_law(const ModelOptions& options, const Answered& a, Figures& figures) {
  const double digits = a.controlled ? 1e-12 : 1e-13;  // a tolerance may sum thousands of substeps
  require_near(a.jump_new, a.jump_old + a.driven - a.stress * a.per_stress, digits * a.size() + kProductOfDenormals,
               "[V] against (61)");
  if (a.pressure <= 0.0) {
    require(a.stress == 0.0, "an open contact carries {} Pa", a.stress);
    return;
  }
  const InterfaceOptions& law = options.interface;
  const double most_friction = std::max(law.friction_coefficient, law.friction_coefficient_fast) * a.pressure;
  const double carried = std::abs(a.stress);
  const bool remembers = !states_of(law.friction_law).empty();  // its friction follows a state, not mu P
  require(remembers || carried <= most_friction * (1 + 1e-12), "s {:.17g} above mu P {:.17g}", a.stress, most_friction);
  if (a.in_parts()) return;  // the stress is then a mean over substeps, with no limit of its own
  if (options.plastic_layer && !is_resolved(options, a, a.size())) return;
  const Limits limit = interface_limits(options, a, a.size());
  // A second-order step answers the mean of two stresses, which cannot be compared with the limit, because the limit
  // changes during the step. Only sticking and the direction of the stress are then checked here; the tests of the
  // scalar reference solver check the two stresses.
  const bool mean = of_two_stages(options, a) && (options.inertia || (a.outcome == 0 && a.regime != Regime::kStick));
  if (!mean) {
    require(carried <= limit.upper, "s {:.17g} above its limit {:.17g} at T0 {:.17g}", a.stress, limit.upper, a.T0);
    if (limit.upper > 0.0) figures.over_limit = std::max(figures.over_limit, carried / limit.upper - 1.0);
  }
  if (options.plastic_layer && a.sticks) return;
  if (a.regime == Regime::kStick) {
    require(a.jump_new == 0.0, "an interface that sticks moves at {} m/s", a.jump_new);
    return;
  }
  // A film may carry less than the solid contact: require_film() holds it to its own law.
  require(mean || options.melt_film || carried >= limit.lower,
          "slips under s {:.17g} below its limit {:.17g} at T0 {:.17g}", a.stress, limit.lower, a.T0);
  if (options.plastic_layer) return;
  require(a.stress * a.jump_new >= -1e-12 * carried * a.size(), "friction pulls past rest: s {}, [V] {}", a.stress,
          a.jump_new);
}

}  // namespace shearbus::testing
