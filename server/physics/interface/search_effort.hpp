// Work of the searches of a step, for benchmarks and tests.
#pragma once

namespace shearbus::physics {

// The lanes of a tile share the sums over the layer: a tile takes as many as its slowest lane. The other members count
// over all lanes.
struct SearchEffort {
  int layer_sums = 0;     // sums of the flow over the layer under one load
  int limit_values = 0;   // evaluations of the limit of an interface or of a layer at its ceiling
  int newton_steps = 0;   // of a layer with inertia
  int guarded_steps = 0;  // lanes among them that needed the guarded search
};

}  // namespace shearbus::physics
