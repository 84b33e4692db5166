// An invariant of every step: the stored heat grows by the heat that enters.
#pragma once

#include <algorithm>
#include <cmath>

#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/figures.hpp"

namespace shearbus::testing {

// Requires that the increase of the stored heat equals the heat that entered in the step  [J/m2].
inline void require_heat_balance(double stored_before, double stored, double heat, Figures& figures) {
  require_near(stored - stored_before, heat, 1e-12 * stored, "stored heat against what entered");
  if (stored > 0.0) {
    figures.heat_residual = std::max(figures.heat_residual, std::abs(stored - stored_before - heat) / stored);
  }
}

}  // namespace shearbus::testing
