// An invariant of server/physics/MODEL.md, "What always holds": friction dissipates energy.
#pragma once

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"

namespace shearbus::testing {

// Requires that friction dissipates: neither stress times slip velocity, s [v], nor the friction heat is negative.
inline void require_dissipation(const Answered& a) {
  require(a.stress * a.slip >= 0.0, "s [v] < 0: s {}, [v] {}", a.stress, a.slip);
  require(a.heat >= 0.0, "heat {} < 0", a.heat);
}

}  // namespace shearbus::testing
