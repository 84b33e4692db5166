// Work of the searches of a step, for benchmarks and tests.
#pragma once

namespace shearbus::physics {

// `layer_sums` counts per tile, because the lanes of a tile are summed together until the slowest lane is done. The
// other members count over all lanes.
struct SearchEffort {
  int layer_sums = 0;     // sums of the flow over the layer under one load
  int limit_values = 0;   // evaluations of the limit of an interface or of a layer at its ceiling
  int newton_steps = 0;   // Newton steps of layers with inertia
  int guarded_steps = 0;  // steps of lanes with inertia that needed the guarded search
};

}  // namespace shearbus::physics
