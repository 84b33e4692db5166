// The answer of one step or substep of one lane.
#pragma once

#include <cstdint>

#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct LaneStep {
  double stress;    // shear stress s, signed             [Pa]
  double slip;      // sliding velocity [v], signed       [m/s]
  double jump_new;  // velocity jump [V] after the step (at n+1/2), signed [m/s]
  double flux;      // heat flux q at z = 0               [W/m2]
  Regime regime;
  bool sticks;   // the interface does not slip at the end of the step
  bool unique;   // false: the step may have several answers; always true if the node sticks and its layer flows
  bool several;  // other answers satisfied the equations of the step too
};

// The answer of a step without heat and flow, and its outcome bits (kOutsideDomain, ..., tile.hpp).
struct RestingStep {
  LaneStep step;
  std::uint8_t outcome = 0;
};

}  // namespace shearbus::physics
