// How often the searches of a step asked, for those who want to know.
#pragma once

namespace shearbus::physics {

// Lanes share the sums over the layer, of which a tile takes as many as the slowest of them; the rest is counted over
// all lanes.
struct SearchEffort {
  int layer_sums = 0;     // of the flow over the layer under one load
  int limit_values = 0;   // of what an interface, or a layer at its ceiling, carries under one stress
  int newton_steps = 0;   // of a layer with inertia
  int guarded_steps = 0;  // of those, lanes that needed the search that cannot fail
};

}  // namespace shearbus::physics
