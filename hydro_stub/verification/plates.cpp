// Two elastic plates on a slide line, under pressure from all sides.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "hydro_stub/grading.hpp"
#include "hydro_stub/verification/exact.hpp"
#include "hydro_stub/verification/problems.hpp"

namespace shearbus::hydro {

using lagrange::Block;
using lagrange::Bodies;
using lagrange::Cycle;
using lagrange::Mesh;
using lagrange::Side;
using lagrange::Vec2;

double shear_impedance(const physics::Material& metal) {
  return std::sqrt(metal.density * metal.shear_modulus);
}

Bodies make_bodies(const PlatesProblem& p) {
  const Vec2 along = {std::cos(p.angle), std::sin(p.angle)};
  const auto turned = [along](Vec2 v) { return v.x * along + v.y * lagrange::left_of(along); };
  Mesh mesh(lagrange::Symmetry::kPlane);
  const auto block = [&](double width, double from, double to) {
    const int nx = static_cast<int>(std::lround(p.length / width));
    if (p.first) {  // the line is where the distance is 0: `from` of the soft plate, `to` of the hard plate
      const std::vector<double> at = graded_nodes(to - from, {*p.first, p.growth, width}).distance;
      const int ny = static_cast<int>(at.size()) - 1;
      return mesh.add_block(nx, ny, [=](int i, int j) {
        return turned({p.length * (static_cast<double>(i) / nx - 0.5), from < 0.0 ? to - at[ny - j] : from + at[j]});
      });
    }
    const int ny = static_cast<int>(std::lround((to - from) / width));
    return mesh.add_block(nx, ny, [=](int i, int j) {
      return turned({p.length * (static_cast<double>(i) / nx - 0.5), from + (to - from) * j / ny});
    });
  };
  const Block soft = block(p.width, 0.0, p.soft_depth);
  const Block hard = block(1.25 * p.width, -p.hard_depth, 0.0);
  Bodies bodies(std::move(mesh));
  // The exact solutions use densities and moduli at zero pressure. Under pressure a metal is denser, so its shear
  // modulus G0 is lowered here to keep the shear impedance sqrt(rho G0).
  const auto add = [&](const Block& at, Metal metal, Vec2 velocity) {
    const double density = density_at(metal.eos, p.pressure);
    metal.strength.shear_modulus *= metal.eos.density / density;
    bodies.materials.push_back(body_material(metal));
    fill(bodies, at, density, 0.0, velocity);
  };
  add(soft, p.soft, p.jump * along);
  add(hard, p.hard, {});
  for (const Side side : {Side::kLeft, Side::kRight, Side::kTop}) bodies.loads.push_back({soft.side(side), p.pressure});
  for (const Side side : {Side::kLeft, Side::kRight, Side::kBottom})
    bodies.loads.push_back({hard.side(side), p.pressure});
  bodies.slide_lines.push_back({lagrange::surface(soft, Side::kBottom), lagrange::surface(hard, Side::kTop)});
  return bodies;
}

// Compares the velocity of the soft plate's face at the middle of the slide line. The friction stress s lowers the
// velocity by s/Z at once, with the shear impedance Z of the plate, and by another 2 s/Z each time the wave returns
// from the free back of the plate.
std::vector<Comparison> compare(const PlatesProblem& p, const Cycle& cycle, double limit) {
  const int middle = cycle.contact().size() / 2;
  const double time = cycle.state().time;
  if (p.jump == 0.0) {
    double fastest = 0.0;
    for (const Vec2 v : cycle.state().velocity) fastest = std::max(fastest, norm(v));
    return {{"largest velocity", "m s-1", 0.0, fastest},
            {"pressure on the line", "Pa", p.pressure, cycle.contact().inputs().pressure[middle]}};
  }
  const double z_soft = shear_impedance(p.soft.strength), z_hard = shear_impedance(p.hard.strength);
  const double admittance = 1.0 / z_soft + 1.0 / z_hard;
  const double stress = std::min(limit, std::abs(p.jump) / admittance);
  const double direction = std::copysign(1.0, p.jump);
  const double soft_round_trip = 2.0 * p.soft_depth * p.soft.strength.density / z_soft;
  const double hard_round_trip = 2.0 * p.hard_depth * p.hard.strength.density / z_hard;
  if (time >= hard_round_trip) return {};
  const double returns = std::floor(time / soft_round_trip);
  const Vec2 along = {std::cos(p.angle), std::sin(p.angle)};
  const int face = cycle.contact().weights().node(middle);
  std::vector<Comparison> found = {{"velocity of the soft plate's face", "m s-1",
                                    p.jump - direction * stress / z_soft * (1.0 + 2.0 * returns),
                                    dot(cycle.state().velocity[face], along)}};
  if (returns == 0.0)
    found.push_back({"velocity jump", "m s-1", p.jump - direction * stress * admittance,
                     cycle.contact().inputs().velocity_jump[middle]});
  return found;
}

}  // namespace shearbus::hydro
