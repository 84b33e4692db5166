#include "hydro_stub/lagrange/heat_depth.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace shearbus::lagrange {

HeatDepth::HeatDepth(const Mesh& mesh, const std::vector<SlideLine>& lines, double soft, double hard)
    : wall_of_zone_(mesh.num_zones(), -1) {
  for (const SlideLine& line : lines) {
    if (!line.rubs) continue;
    add(mesh, line.soft, soft);
    add(mesh, line.hard, hard);
  }
}

void HeatDepth::add(const Mesh& mesh, const Surface& surface, double diffusivity) {
  const std::vector<Vec2>& x = mesh.places();
  for (std::size_t s = 0; s < surface.zones.size(); ++s) {
    const int wall = surface.zones[s];
    int edge = 0;  // the edge of the zone that lies on the wall
    while (edge < 3 && mesh.zone_nodes(wall)[edge] != surface.nodes[s]) ++edge;
    Behind behind{.diffusivity = diffusivity, .zones = {}, .thickness = {}};
    for (int zone = wall; zone >= 0; zone = mesh.neighbour(zone, (edge + 2) % 4)) {
      const int* n = mesh.zone_nodes(zone);
      const double area = 0.5 * cross(x[n[2]] - x[n[0]], x[n[3]] - x[n[1]]);
      behind.zones.push_back(zone);
      behind.thickness.push_back(area / norm(x[n[(edge + 1) % 4]] - x[n[edge]]));
    }
    wall_of_zone_[wall] = static_cast<int>(walls_.size());
    walls_.push_back(std::move(behind));
  }
}

template <class Each>
void HeatDepth::spread(int wall_zone, double time, const Each& each) const {
  const Behind& behind = walls_[wall_of_zone_[wall_zone]];
  double whole = 0.0;
  for (const double thickness : behind.thickness) whole += thickness;
  const double reached = std::sqrt(behind.diffusivity * std::max(0.0, time));
  const double depth = std::min(whole, std::max(behind.thickness.front(), reached));
  double left = depth;
  for (std::size_t k = 0; k < behind.zones.size() && left > 0.0; ++k) {
    each(behind.zones[k], std::min(left, behind.thickness[k]) / depth);
    left -= behind.thickness[k];
  }
}

void HeatDepth::give(int wall_zone, double heat, double time, const std::vector<double>& mass,
                     std::vector<double>& energy) const {
  spread(wall_zone, time, [&](int zone, double share) { energy[zone] += share * heat / mass[zone]; });
}

double HeatDepth::mean(int wall_zone, double time, const std::vector<double>& quantity) const {
  double mean = 0.0;
  spread(wall_zone, time, [&](int zone, double share) { mean += share * quantity[zone]; });
  return mean;
}

}  // namespace shearbus::lagrange
