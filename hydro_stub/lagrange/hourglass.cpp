#include "hydro_stub/lagrange/hourglass.hpp"

#include <array>
#include <cmath>

namespace shearbus::lagrange {

void add_hourglass(const Mesh& mesh, double coefficient, const Geometry& geometry, const std::vector<Vec2>& position,
                   const std::vector<Vec2>& velocity, const std::vector<double>& density,
                   const std::vector<double>& sound_speed, std::vector<Vec2>& corner_force) {
  if (coefficient == 0.0) return;
  const int zones = mesh.num_zones();
  constexpr std::array<double, 4> kMode = {1.0, -1.0, 1.0, -1.0};
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int zone = 0; zone < zones; ++zone) {
    const int* n = mesh.zone_nodes(zone);
    const std::array<Vec2, 4> x = {position[n[0]], position[n[1]], position[n[2]], position[n[3]]};
    const Vec2 skew = (x[0] - x[1]) + (x[2] - x[3]);
    const double inverse_area = 1.0 / geometry.area[zone];
    // The hourglass mode (+1, -1, +1, -1 on the corners) less the part that linear velocity fields contain.
    std::array<double, 4> mode;
    Vec2 rate;
    for (int k = 0; k < 4; ++k) {
      const Vec2 slope = 0.5 * right_of(x[(k + 1) % 4] - x[(k + 3) % 4]);
      mode[k] = kMode[k] - inverse_area * dot(slope, skew);
      rate += mode[k] * velocity[n[k]];
    }
    const double mean_radius = geometry.volume[zone] * inverse_area;  // mean radius of the zone; 1 in plane symmetry
    const double damping =
        0.25 * coefficient * density[zone] * sound_speed[zone] * std::sqrt(geometry.area[zone]) * mean_radius;
    for (int k = 0; k < 4; ++k) corner_force[4 * zone + k] -= (damping * mode[k]) * rate;
  }
}

}  // namespace shearbus::lagrange
