// An invariant of every step: the stored heat grows by the heat that enters.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/figures.hpp"
#include "tests/support/physics_rig.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// Heat that leaves through the faces that keep their temperature (FarBoundary::kIsothermal) in the rig's last step
// [J/m2]; their temperatures must be those of the step before, to some ulps, because conduction works on the temperature
// above that of the colder end. NaN: not known to the accuracy of the balance, because the
// step had several stages, or conducts so much that the last digits of the temperatures count.
inline double heat_left_through_held_faces(const Rig& rig, int lane, double dt) {
  const HeatGrid& grid = rig.heat_grid();
  if (!grid.soft_end_is_held && !grid.hard_end_is_held) return 0.0;
  const ModelOptions& o = rig.model.options();
  if (o.modes) return std::numeric_limits<double>::quiet_NaN();  // no profile, and no mode that keeps the heat
  const std::vector<double> before = rig.temperatures(rig.trial, lane), T = rig.temperatures(rig.committed, lane);
  double left = 0.0, noise = 0.0;
  const auto leaves = [&](const Material& m, std::size_t cell, std::size_t inner, std::size_t face) {
    require(std::abs(T[face] - before[face]) <= kDigits * before[face], "a held face goes from {:.17g} to {:.17g} K",
            before[face], T[face]);
    const double conducted = m.conductivity / grid.width[cell] * dt;  // heat per difference of temperature [J/(m2 K)]
    left += conducted * (T[inner] - T[face]);
    noise += conducted * 8.0 * std::numeric_limits<double>::epsilon() * (T[inner] + T[face]);
  };
  const std::size_t last = T.size() - 1;
  if (grid.soft_end_is_held) leaves(o.soft, last - 1, last - 1, last);
  if (grid.hard_end_is_held) leaves(o.hard, 0, 1, 0);
  // Work at a held vertex leaves at once, substeps and coefficients of each step leave at rates of their own.
  const bool simple = !o.taylor_quinney_factor && !o.tolerance && !conducts_by_temperature(o);
  const bool one_stage = simple && o.time_integrator == TimeIntegrator::kBackwardEuler &&
                         (rig.outputs.outcome[lane] & (kSubstepped | kFailed)) == 0;
  const bool resolved = noise < 1e-13 * rig.stored_heat(0.0, lane);
  return one_stage && resolved ? left : std::numeric_limits<double>::quiet_NaN();
}

// Requires that the increase of the stored heat equals the heat that entered in the step  [J/m2].
// `share`: of the heat that may be missing, where coefficients follow the temperature.
inline void require_heat_balance(double stored_before, double stored, double heat, Figures& figures,
                                 double share = 0.0) {
  require_near(stored - stored_before, heat, (share > 0.0 ? 1e-10 : 1e-12) * stored + share * std::abs(heat),
               "stored heat against what entered");
  if (stored > 0.0 && share == 0.0) {
    figures.heat_residual = std::max(figures.heat_residual, std::abs(stored - stored_before - heat) / stored);
  }
}

}  // namespace shearbus::testing
