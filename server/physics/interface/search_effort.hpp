// Counters of the work that the root searches of a step do, for benchmarks and tests.
#pragma once

namespace shearbus::physics {

// `layer_sums` counts per tile, because the lanes of a tile are summed together until the slowest lane is done. Every
// other member adds up the counts of all lanes.
struct SearchEffort {
  int layer_sums = 0;     // number of sums of the flow over the layer
  int limit_values = 0;   // number of evaluations of the limit of an interface, or of the ceiling of a layer
  int newton_steps = 0;   // number of Newton steps of layers with inertia
  int guarded_steps = 0;  // number of steps of lanes with inertia that needed the guarded search
};

}  // namespace shearbus::physics
