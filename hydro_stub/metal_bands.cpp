#include "hydro_stub/metal_bands.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::hydro {
namespace {

using lagrange::Mesh;
using lagrange::Vec2;

constexpr std::array<Vec2, 4> kCorners = {Vec2{-1, -1}, Vec2{1, -1}, Vec2{1, 1}, Vec2{-1, 1}};

std::array<double, 4> shape_functions(Vec2 at) {
  std::array<double, 4> shape;
  for (std::size_t k = 0; k < 4; ++k) shape[k] = 0.25 * (1.0 + at.x * kCorners[k].x) * (1.0 + at.y * kCorners[k].y);
  return shape;
}

// Returns the zone with the place, or the zone of the block that is nearest to it: walks from `zone` across edges that
// have the place on their outer side.
int zone_at(const Mesh& mesh, int zone, Vec2 place) {
  for (int moves = 0; moves < mesh.num_zones(); ++moves) {
    const int* n = mesh.zone_nodes(zone);
    int next = -1;
    for (int k = 0; k < 4 && next < 0; ++k) {
      const Vec2 from = mesh.places()[n[k]];
      if (cross(mesh.places()[n[(k + 1) % 4]] - from, place - from) < 0.0) next = mesh.neighbour(zone, k);
    }
    if (next < 0) return zone;
    zone = next;
  }
  return zone;
}

// Returns the coordinates of the place in the reference square of a zone, cut to the square.
Vec2 reference_of(const Mesh& mesh, int zone, Vec2 place) {
  const int* n = mesh.zone_nodes(zone);
  Vec2 at;
  constexpr int kIterations = 20;
  for (int i = 0; i < kIterations; ++i) {
    const std::array<double, 4> shape = shape_functions(at);
    Vec2 missing = place, along_xi, along_eta;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec2 x = mesh.places()[n[k]];
      missing = missing - shape[k] * x;
      along_xi += (0.25 * kCorners[k].x * (1.0 + at.y * kCorners[k].y)) * x;
      along_eta += (0.25 * kCorners[k].y * (1.0 + at.x * kCorners[k].x)) * x;
    }
    const double inverse = 1.0 / cross(along_xi, along_eta);
    at += Vec2{inverse * cross(missing, along_eta), inverse * cross(along_xi, missing)};
  }
  return {std::clamp(at.x, -1.0, 1.0), std::clamp(at.y, -1.0, 1.0)};
}

}  // namespace

MetalBands::MetalBands(const lagrange::Bodies& bodies) {
  const Mesh& mesh = bodies.mesh;
  lagrange::InterfaceWeights weights(mesh.symmetry(), bodies.slide_lines);
  weights.find(mesh.places());
  const auto point = [&](int zone, Vec2 place, double distance) -> std::optional<Point> {
    const int at = zone_at(mesh, zone, place);
    Point found{};
    found.weight = shape_functions(reference_of(mesh, at, place));
    Vec2 there;
    for (std::size_t k = 0; k < 4; ++k) {
      found.node[k] = mesh.zone_nodes(at)[k];
      there += found.weight[k] * mesh.places()[found.node[k]];
    }
    // At an end of an oblique line the normal may leave the body through the end: the nearest point then serves.
    constexpr double kFarthest = 0.25;
    if (norm(place - there) > kFarthest * distance) return std::nullopt;
    return found;
  };
  for (std::size_t band = 0; band < kDistances.size(); ++band) {
    points_[band].resize(weights.rubbing());
    for (int i = 0; i < weights.rubbing(); ++i) {
      if (!weights.faces(i)) continue;
      const Vec2 node = mesh.places()[weights.node(i)];
      const Vec2 outward = lagrange::right_of(weights.tangent(i));
      const double distance = kDistances[band];
      const auto soft = point(weights.zones_at(i)[0], node - distance * outward, distance);
      const auto hard = point(weights.hard_zones(i).front().zone, node + distance * outward, distance);
      if (soft && hard) points_[band][i] = {*soft, *hard};
    }
  }
}

double MetalBands::velocity_difference(const lagrange::Cycle& cycle, std::size_t band, std::size_t i) const {
  const std::optional<Pair>& pair = points_[band][i];
  const lagrange::InterfaceWeights& weights = cycle.contact().weights();
  if (!pair || !weights.faces(static_cast<int>(i))) return 0.0;
  Vec2 difference;
  for (std::size_t k = 0; k < 4; ++k) {
    difference += pair->soft.weight[k] * cycle.state().velocity[pair->soft.node[k]];
    difference += (-pair->hard.weight[k]) * cycle.state().velocity[pair->hard.node[k]];
  }
  return dot(difference, weights.tangent(static_cast<int>(i)));
}

}  // namespace shearbus::hydro
