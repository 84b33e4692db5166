#include "hydro_stub/lagrange/boundary.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace shearbus::lagrange {

std::vector<Vec2> pressure_forces(const Mesh& mesh, const PressureLoad& load, const std::vector<Vec2>& position) {
  std::vector<Vec2> force(load.nodes.size());
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
  for (std::size_t s = 0; s + 1 < load.nodes.size(); ++s) {
    const int i = load.nodes[s];
    const int j = load.nodes[s + 1];
    const Vec2 inward = load.pressure * left_of(position[j] - position[i]);
    const double ri = position[i].x;
    const double rj = position[j].x;
    force[s] += (axisymmetric ? (2.0 * ri + rj) / 6.0 : 0.5) * inward;
    force[s + 1] += (axisymmetric ? (ri + 2.0 * rj) / 6.0 : 0.5) * inward;
  }
  return force;
}

Guides::Guides(int num_nodes, const std::vector<Wall>& walls) : normals_(num_nodes) {
  for (const Wall& wall : walls) {
    for (const int node : wall.nodes) {
      Normals& n = normals_[node];
      if (norm(n.first) == 0.0) {
        n.first = wall.normal;
      } else if (norm(n.second) == 0.0 && std::abs(dot(n.first, wall.normal)) < 1e-12) {
        n.second = wall.normal;
      } else {
        throw std::invalid_argument(
            fmt::format("node {} lies on walls that are not at right angles (or on more than two)", node));
      }
    }
  }
}

}  // namespace shearbus::lagrange
