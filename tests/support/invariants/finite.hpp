// Check that the answer of a step exists and is finite.
#pragma once

#include <cmath>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"

namespace shearbus::testing {

inline void require_numbers(const Answered& a) {
  require(!(a.outcome & kFailed), "no answer was found");
  require(std::isfinite(a.stress) && std::isfinite(a.slip) && std::isfinite(a.jump_new) && std::isfinite(a.T0) &&
              std::isfinite(a.heat),
          "not a number: s {}, [v] {}, [V] {}, T0 {}, heat {}", a.stress, a.slip, a.jump_new, a.T0, a.heat);
}

}  // namespace shearbus::testing
