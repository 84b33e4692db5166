// The answer of one step or substep of one lane.
#pragma once

#include <cstdint>

#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct LaneStep {
  double stress;    // s, signed                          [Pa]
  double slip;      // [v], signed                        [m/s]
  double jump_new;  // [V] at n+1/2                       [m/s]
  double flux;      // q                                  [W/m2]
  Regime regime;
  bool sticks;   // the interface does not slip at the end of the step
  bool unique;   // the criterion of server/physics/MODEL.md, "Force-driven step" holds
  bool several;  // several answers satisfied the step
};

// A step without heat and flow, and the bits of its outcome.
struct RestingStep {
  LaneStep step;
  std::uint8_t outcome = 0;
};

}  // namespace shearbus::physics
