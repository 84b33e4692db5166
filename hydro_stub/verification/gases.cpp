// Strong shocks in ideal gases: the problems of Noh, Sedov and Saltzman, which show errors of energy conservation and
// of symmetry.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

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

// A square of gas with planes of symmetry at its left and bottom; in axisymmetry these are the axis and the equatorial
// plane.
Bodies quarter(Symmetry symmetry, int zones, double length, double gamma) {
  Mesh mesh(symmetry);
  const Block block = mesh.add_block(zones, zones, [=](int i, int j) {
    return (length / zones) * Vec2{double(i), double(j)};
  });
  Bodies bodies(std::move(mesh));
  bodies.materials.push_back({.eos = lagrange::Eos(lagrange::IdealGas{.gamma = gamma}), .strength = {}});
  fill(bodies, block, 1.0, 0.0, {});
  bodies.walls.push_back({block.side(Side::kLeft), {1.0, 0.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
  return bodies;
}

Vec2 centre(const Cycle& cycle, int zone) {
  const int* n = cycle.mesh().zone_nodes(zone);
  const auto& x = cycle.state().position;
  return 0.25 * ((x[n[0]] + x[n[1]]) + (x[n[2]] + x[n[3]]));
}

}  // namespace

// W. F. Noh, J. Comput. Phys. 72 (1987) 78: gas with gamma = 5/3 flows to the origin with speed 1 and stops behind a
// shock at r = t/3. Behind the shock rho = 4^d, with d = 2 for flow to a line (plane) and d = 3 for flow to a point
// (axisymmetric).
Bodies make_bodies(const NohProblem& p) {
  Bodies bodies = quarter(p.symmetry, p.zones, 1.0, 5.0 / 3.0);
  for (std::size_t n = 0; n < bodies.velocity.size(); ++n) {
    const Vec2 x = bodies.mesh.places()[n];
    const double r = norm(x);
    bodies.velocity[n] = r > 0.0 ? (-1.0 / r) * x : Vec2{};
  }
  return bodies;
}

std::vector<Comparison> compare(const NohProblem& p, const Cycle& cycle) {
  const double dimension = p.symmetry == Symmetry::kPlane ? 2.0 : 3.0;
  const double exact = std::pow(4.0, dimension);
  const double time = cycle.state().time;
  const double shock = time / 3.0;
  double mass = 0.0, volume = 0.0, shocked = 0.0, error = 0.0, reference = 0.0;
  for (int z = 0; z < cycle.mesh().num_zones(); ++z) {
    const double r = norm(centre(cycle, z));
    const double rho = cycle.state().density[z];
    const double v = cycle.state().volume[z];
    if (r > 0.3 * shock && r < 0.8 * shock) mass += rho * v, volume += v;
    if (rho > 0.5 * exact) shocked += v;
    if (r > 1.75 * shock) continue;
    const double right = r < shock ? exact : std::pow(1.0 + time / r, dimension - 1.0);
    error += std::abs(rho - right) * v;
    reference += right * v;
  }
  const double front =
      p.symmetry == Symmetry::kPlane ? std::sqrt(4.0 * shocked / std::numbers::pi) : std::cbrt(3.0 * shocked);
  return {{"mean density behind the shock", "kg m-3", exact, mass / volume},
          {"radius of the shock", "m", shock, front},
          {"mean error of the density", "1", 0.0, error / reference}};
}

// The point blast of L. I. Sedov. With gamma = 1.4, density 1 and the energy set here the shock is at r = 1 at t = 1.
Bodies make_bodies(const SedovProblem& p) {
  Bodies bodies = quarter(p.symmetry, p.zones, 1.2, 1.4);
  // Energy of the blast in the modelled part: a quarter of the plane per depth, or the upper half of space per radian.
  const double energy = p.symmetry == Symmetry::kPlane ? 0.984041 / 4.0 : 0.851072 / 2.0 / (2.0 * std::numbers::pi);
  std::vector<double> volume(bodies.mesh.num_zones());
  measure_volumes(bodies.mesh, bodies.mesh.places(), volume);
  bodies.energy[0] = energy / volume[0];
  return bodies;
}

std::vector<Comparison> compare(const SedovProblem& p, const Cycle& cycle) {
  double peak = 0.0, outermost = 0.0, innermost = 2.0;
  // The shock on each of nine rays from the origin is where the density is largest.
  for (int ray = 0; ray < 9; ++ray) {
    const double angle = (ray + 0.5) / 9.0 * 0.5 * std::numbers::pi;
    double best = 0.0, at = 0.0;
    for (int z = 0; z < cycle.mesh().num_zones(); ++z) {
      const Vec2 x = centre(cycle, z);
      if (std::abs(std::atan2(x.y, x.x) - angle) > 0.087 || cycle.state().density[z] < best) continue;
      best = cycle.state().density[z];
      at = norm(x);
    }
    peak = std::max(peak, best);
    outermost = std::max(outermost, at);
    innermost = std::min(innermost, at);
  }
  const double shock = std::pow(cycle.state().time, p.symmetry == Symmetry::kPlane ? 0.5 : 0.4);
  return {{"radius of the shock", "m", shock, 0.5 * (outermost + innermost)},
          {"largest density", "kg m-3", 6.0, peak},
          {"spread of the front", "m", 0.0, outermost - innermost}};
}

// J. Saltzman's piston: a plane shock of infinite strength (gamma = 5/3, piston speed 1, shock speed 4/3, density 4)
// runs through a mesh whose lines are skewed.
Bodies make_bodies(const SaltzmanProblem& p) {
  const int nx = 10 * p.zones, ny = p.zones;
  Mesh mesh(Symmetry::kPlane);
  const Block block = mesh.add_block(nx, ny, [&](int i, int j) {
    const double x = static_cast<double>(i) / nx, y = 0.1 * j / ny;
    return Vec2{x + (0.1 - y) * std::sin(std::numbers::pi * x), y};
  });
  Bodies bodies(std::move(mesh));
  bodies.materials.push_back({.eos = lagrange::Eos(lagrange::IdealGas{}), .strength = {}});
  fill(bodies, block, 1.0, 1e-4, {});
  bodies.walls.push_back({block.side(Side::kLeft), {1.0, 0.0}, 1.0});
  bodies.walls.push_back({block.side(Side::kRight), {1.0, 0.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
  bodies.walls.push_back({block.side(Side::kTop), {0.0, 1.0}, 0.0});
  return bodies;
}

std::vector<Comparison> compare(const SaltzmanProblem& /*problem*/, const Cycle& cycle) {
  const double piston = cycle.state().time;
  const double shock = 4.0 / 3.0 * piston;
  double error = 0.0, mass = 0.0, volume = 0.0, crossing = 0.0;
  for (int z = 0; z < cycle.mesh().num_zones(); ++z) {
    const double x = centre(cycle, z).x, v = cycle.state().volume[z], rho = cycle.state().density[z];
    error += std::abs(rho - (x < shock ? 4.0 : 1.0)) * v;
    if (x > piston + 0.2 * (shock - piston) && x < piston + 0.8 * (shock - piston)) mass += rho * v, volume += v;
  }
  for (const Vec2 v : cycle.state().velocity) crossing = std::max(crossing, std::abs(v.y));
  constexpr double kVolume = 0.1;  // volume of the channel
  return {{"mean density behind the shock", "kg m-3", 4.0, mass / volume},
          {"mean error of the density", "kg m-3", 0.0, error / kVolume},
          {"largest cross velocity", "m s-1", 0.0, crossing}};
}

}  // namespace shearbus::hydro
