#include "server/physics/solver/velocity_driven/mean_stress.hpp"

#include <cstddef>

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

double onset_of_flow(const Grid& grid, const Material& soft, double pressure, double dt, const FlowedLayer& layer,
                     double friction) {
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
