// Plastic flow at large strain: shells that implode until plastic work has stopped them, and Taylor's bar.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "hydro_stub/verification/exact.hpp"
#include "hydro_stub/verification/problems.hpp"

namespace shearbus::hydro {

using lagrange::Block;
using lagrange::Bodies;
using lagrange::Cycle;
using lagrange::Mesh;
using lagrange::Side;
using lagrange::Symmetry;
using lagrange::Vec2;

namespace {

// A sector of the imploding cylinder in plane symmetry; the mesh index i runs along the radius.
Bodies cylinder_sector(const ImplosionProblem& p) {
  constexpr int kAround = 4;
  constexpr double kAngle = 0.2;
  Mesh mesh(Symmetry::kPlane);
  const Block block = mesh.add_block(p.zones, kAround, [&](int i, int j) {
    const double r = p.inner + (p.outer - p.inner) * i / p.zones;
    const double angle = kAngle * j / kAround;
    return Vec2{r * std::cos(angle), r * std::sin(angle)};
  });
  Bodies bodies(std::move(mesh));
  bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kTop), {-std::sin(kAngle), std::cos(kAngle)}, 0.0});
  return bodies;
}

// A slice of a long imploding cylinder in axisymmetry; the mesh index i runs along the radius.
Bodies cylinder_slice(const ImplosionProblem& p) {
  constexpr int kAlong = 4;
  Mesh mesh(Symmetry::kAxisymmetric);
  const double width = (p.outer - p.inner) / p.zones;
  const Block block = mesh.add_block(p.zones, kAlong, [&](int i, int j) {
    return Vec2{p.inner + width * i, width * j};
  });
  Bodies bodies(std::move(mesh));
  bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kTop), {0.0, 1.0}, 0.0});
  return bodies;
}

// The upper half of a spherical shell; the mesh index i runs from the equator to the axis, the index j inward.
Bodies sphere(const ImplosionProblem& p) {
  const int around = 2 * p.zones;
  Mesh mesh(Symmetry::kAxisymmetric);
  const Block block = mesh.add_block(around, p.zones, [&](int i, int j) {
    const double r = p.outer + (p.inner - p.outer) * j / p.zones;
    const double angle = 0.5 * std::numbers::pi * i / around;
    return Vec2{i == around ? 0.0 : r * std::cos(angle), i == 0 ? 0.0 : r * std::sin(angle)};
  });
  Bodies bodies(std::move(mesh));
  bodies.walls.push_back({block.side(Side::kLeft), {0.0, 1.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kRight), {1.0, 0.0}, 0.0});
  return bodies;
}

// Returns the position of x relative to the centre of a sphere or circle; in a slice of a long cylinder, relative to
// the axis.
Vec2 radius_vector(const ImplosionProblem& p, Vec2 x) {
  return !p.sphere && p.symmetry == Symmetry::kAxisymmetric ? Vec2{x.x, 0.0} : x;
}

std::vector<int> inner_surface(const ImplosionProblem& p, const Cycle& cycle) {
  return cycle.mesh().blocks()[0].side(p.sphere ? Side::kTop : Side::kLeft);
}

}  // namespace

Bodies make_bodies(const ImplosionProblem& p) {
  Bodies bodies = p.sphere ? sphere(p) : p.symmetry == Symmetry::kAxisymmetric ? cylinder_slice(p) : cylinder_sector(p);
  bodies.materials.push_back(body_material(p.metal));
  fill(bodies, bodies.mesh.blocks()[0], p.metal.eos.density, 0.0, {});
  const double speed =
      p.sphere ? sphere_speed(p.metal, p.inner, p.outer, p.stop) : cylinder_speed(p.metal, p.inner, p.outer, p.stop);
  for (std::size_t n = 0; n < bodies.velocity.size(); ++n) {
    const Vec2 x = radius_vector(p, bodies.mesh.places()[n]);
    const double r = norm(x);
    bodies.velocity[n] = (-speed * std::pow(p.inner / r, p.sphere ? 2.0 : 1.0) / r) * x;
  }
  return bodies;
}

bool at_rest(const ImplosionProblem& p, const Cycle& cycle) {
  double inward = 0.0;
  for (const int n : inner_surface(p, cycle)) {
    const Vec2 x = radius_vector(p, cycle.state().position[n]);
    inward -= dot(cycle.state().velocity[n], x) / norm(x);
  }
  return inward <= 0.0;
}

std::vector<Comparison> compare(const ImplosionProblem& p, const Cycle& cycle) {
  double low = p.outer, high = 0.0, sum = 0.0;
  const std::vector<int> inner = inner_surface(p, cycle);
  for (const int n : inner) {
    const double r = norm(radius_vector(p, cycle.state().position[n]));
    low = std::min(low, r);
    high = std::max(high, r);
    sum += r;
  }
  return {{"inner radius at rest", "m", p.stop, sum / static_cast<double>(inner.size())},
          {"spread of the inner radius", "m", 0.0, high - low}};
}

Bodies make_bodies(const TaylorProblem& p) {
  const int along = static_cast<int>(std::lround(p.zones * p.length / p.radius));
  Mesh mesh(Symmetry::kAxisymmetric);
  const Block block = mesh.add_block(p.zones, along, [&](int i, int j) {
    return Vec2{p.radius * i / p.zones, p.length * j / along};
  });
  Bodies bodies(std::move(mesh));
  bodies.materials.push_back(body_material(p.metal));
  fill(bodies, block, p.metal.eos.density, 0.0, {0.0, -p.speed});
  for (const int n : block.side(Side::kBottom)) bodies.velocity[n].y = 0.0;
  bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kLeft), {1.0, 0.0}, 0.0});
  return bodies;
}

std::vector<int> free_surface(const TaylorProblem&, const Bodies& bodies) {
  return bodies.mesh.blocks()[0].side(Side::kRight);
}

// Taylor's copper bar, length 32.4 mm, radius 3.2 mm, 227 m/s, with Y = 400 MPa + 100 MPa ep. Codes in the literature
// find a length of 21.4-21.7 mm and a foot radius of 6.97-7.24 mm at 80 us; the comparison uses the middle of each
// range.
std::vector<Comparison> compare(const TaylorProblem& p, const Cycle& cycle) {
  if (p.length != 32.4e-3 || p.radius != 3.2e-3 || p.speed != 227.0) return {};
  const Block& block = cycle.mesh().blocks()[0];
  return {{"length", "m", 21.55e-3, cycle.state().position[block.node(0, block.ny)].y},
          {"radius of the foot", "m", 7.105e-3, cycle.state().position[block.node(p.zones, 0)].x}};
}

}  // namespace shearbus::hydro
