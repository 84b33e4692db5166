// Counts the work of a step of one lane. The unit is an evaluation: the flow of one cell is evaluated once, by a law
// without rate, which takes a core about 10 ns. The count depends on the lane's own state and inputs alone, so it is
// the same in any batch.
#pragma once

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

inline constexpr double kSearchWork = 64.0;  // work of a search that evaluates only the interface

// Work of one evaluation of a law's flow, measured as the time of a step relative to that of a law without rate.
inline double flow_work(FlowLaw law) {
  constexpr double kWithRate = 16.0, kCoupled = 44.0;
  const FlowLawProperties properties = properties_of(law);
  return !properties.separable ? kCoupled : properties.depends_on_rate ? kWithRate : 1.0;
}

inline void add_work(const TileInputs& inputs, int lane, double evaluations) {
  if (inputs.work != nullptr) inputs.work[lane] += evaluations;
}

}  // namespace shearbus::physics
