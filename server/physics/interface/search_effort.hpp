// Counters of the work that the root searches of a step do, for benchmarks and tests.
#pragma once

namespace shearbus::physics {

// Of a flowing layer `layer_sums` counts per tile, because the lanes of a tile are summed together until the slowest
// lane is done. Every other count adds up those of all lanes.
struct SearchEffort {
  int layer_sums = 0;    // how often plastic flow was summed over a layer, or the phases of a melting one were solved
  int limit_values = 0;  // evaluations of a stress limit: the interface's, a film's, or the layer's ceiling (Y_max)
  int wave_evaluations = 0;  // evaluations of the balance of momentum of a layer with inertia
};

}  // namespace shearbus::physics
