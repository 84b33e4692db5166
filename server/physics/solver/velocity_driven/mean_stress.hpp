// The mean stress of a velocity-driven step (MODEL.md, "Mean stress of a step"): the impulse of the stress over the
// step, divided by dt. Computed only on request, from what the solved step knows; it changes no state.
#pragma once

#include <algorithm>
#include <cstddef>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// The path of the stress of one lane in a step, along the direction of its trial stress  [Pa].
struct StressPath {
  double start;  // stress before the step
  double trial;  // elastic trial stress: the end of the path if neither layer nor interface yields
  double end;    // stress at the end of the step
};

// The mean over the step of a stress that stays elastic: its path is straight  [Pa].
inline double mean_of(const StressPath& path) {
  return 0.5 * (path.start + path.end);
}

// The mean over the step of a stress that rises elastically, at (trial - start) per step, until it meets `onset`, where
// flow or slip begins, and changes from there to `end` at a constant rate. A stress beyond the onset before the step
// relaxes to it at once  [Pa].
inline double mean_of(const StressPath& path, double onset) {
  const double start = std::clamp(path.start, -onset, onset);
  const double rise = path.trial - path.start;  // elastic change of the stress in the whole step
  if (!(rise > onset - start)) return 0.5 * (start + path.end);
  const double elastic = (onset - start) / rise;  // fraction of the step
  return 0.5 * (elastic * (start + onset) + (1.0 - elastic) * (onset + path.end));
}

// The stress at which the flow of one lane begins: the flow stress Y(ep, dep/dt, P, T) / sqrt(3) at the strains and
// temperatures before the step and the mean strain rate of the step, weighted by the flow of each vertex; at most
// `friction`, the friction limit mu P. The rows are [vertex][lane], from the lane's value at z = 0 on  [Pa].
struct FlowedLayer {
  const double* T_old;
  const double* strain_old;
  const double* strain_new;
};
inline double onset_of_flow(const Grid& grid, const Material& soft, double pressure, double dt,
                            const FlowedLayer& layer, double friction) {
  double flow = 0.0, work = 0.0;
  for (std::ptrdiff_t i = 0; i < grid.num_vertices(); ++i) {
    const std::ptrdiff_t at = i * kLanes;
    const double increment = layer.strain_new[at] - layer.strain_old[at];
    if (!(increment > 0.0)) continue;
    const double slip = grid.weight[static_cast<std::size_t>(i)] * increment;
    flow += slip;
    work += slip * flow_stress(soft, layer.strain_old[at], pressure, layer.T_old[at], increment / dt);
  }
  return flow > 0.0 ? std::min(friction, work / (flow * kSqrt3)) : friction;
}

}  // namespace shearbus::physics
