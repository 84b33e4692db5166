// Counters of the work that the root searches of a step do, for benchmarks and tests.
#pragma once

namespace shearbus::physics {

// `layer_sums` counts per tile, because the lanes of a tile are summed together until the slowest lane is done. Every
// other member adds up the counts of all lanes.
struct SearchEffort {
  int layer_sums = 0;     // number of times that the plastic flow was summed over the vertices of the layer
  int limit_values = 0;   // number of evaluations of a stress limit: the interface's, or the layer's ceiling (Y_max)
  int newton_steps = 0;   // number of Newton steps of layers with inertia
  int guarded_steps = 0;  // number of lanes with inertia for which Newton's method failed and a bisection took over
};

}  // namespace shearbus::physics
