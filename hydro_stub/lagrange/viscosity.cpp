#include "hydro_stub/lagrange/viscosity.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::lagrange {
namespace {

struct Difference {
  Vec2 place;
  Vec2 velocity;
};

// Velocity slope of a neighbouring edge over that of this one, both along this one's directions.
double slope_ratio(const Difference& neighbour, const Difference& edge) {
  const double along = dot(neighbour.place, edge.place);
  if (!(along > 0.0)) return 0.0;
  return dot(neighbour.velocity, edge.velocity) * dot(edge.place, edge.place) /
         (along * dot(edge.velocity, edge.velocity));
}

}  // namespace

void add_viscosity(const Mesh& mesh, const ViscosityOptions& options, double half_shock_slope,
                   const std::vector<Vec2>& position, const std::vector<Vec2>& velocity,
                   const std::vector<double>& density, const std::vector<double>& sound_speed, int first, int last,
                   std::vector<Vec2>& corner_force, std::vector<double>& viscous_speed) {
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
  const auto between = [&](int from, int to) {
    return Difference{position[to] - position[from], velocity[to] - velocity[from]};
  };
#pragma omp parallel for schedule(static) if (last - first >= kFewestForThreads)
  for (int zone = first; zone < last; ++zone) {
    const int* n = mesh.zone_nodes(zone);
    const Vec2 centre = 0.25 * ((position[n[0]] + position[n[1]]) + (position[n[2]] + position[n[3]]));
    double fastest = 0.0;
    for (int k = 0; k < 4; ++k) {
      const int next = (k + 1) % 4;
      const int i = n[k];
      const int j = n[next];
      const Difference edge = between(i, j);
      const double speed = norm(edge.velocity);
      const Vec2 middle = 0.5 * (position[i] + position[j]);
      // Radius of the area: weighted like the pressure's, so that plane waves along the axis stay plane.
      const double opposite = 0.5 * (position[n[(k + 2) % 4]].x + position[n[(k + 3) % 4]].x);
      const double radius = axisymmetric ? (2.0 * middle.x + opposite) / 3.0 : 1.0;
      const Vec2 area = radius * left_of(middle - centre);
      const double closing = -dot(edge.velocity, area);
      if (!(closing > 0.0) || !(speed > 0.0)) continue;

      const int before = mesh.line_before(zone, k);
      const int after = mesh.line_after(zone, k);
      double psi = 0.0;  // without neighbours nothing shows that the flow is smooth
      if (before >= 0 || after >= 0) {
        const double back = before >= 0 ? slope_ratio(between(before, i), edge) : slope_ratio(between(j, after), edge);
        const double ahead = after >= 0 ? slope_ratio(between(j, after), edge) : back;
        psi = std::max(0.0, std::min({0.5 * (back + ahead), 2.0 * back, 2.0 * ahead, 1.0}));
      }
      const double shock = options.quadratic * half_shock_slope * speed;
      const double sound = options.linear * sound_speed[zone];
      const double viscous = (1.0 - psi) * (shock + std::sqrt(shock * shock + sound * sound));
      const Vec2 force = (density[zone] * viscous * closing / speed) * edge.velocity;
      corner_force[4 * zone + k] += force;
      corner_force[4 * zone + next] -= force;
      fastest = std::max(fastest, viscous);
    }
    viscous_speed[zone] = fastest;
  }
}

}  // namespace shearbus::lagrange
