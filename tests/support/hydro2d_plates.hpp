// Two plates on a slide line: the sliding problems with exact solutions.
#pragma once

#include "tests/support/hydro2d.hpp"

namespace shearbus::test {

inline const double kZSoft = std::sqrt(2703.0 * 27.6e9);
inline const double kZHard = std::sqrt(7900.0 * 77e9);

struct Plates {
  double length = 3e-3;  // along the line
  double soft_depth = 0.4e-3;
  double hard_depth = 0.4e-3;
  double width = 20e-6;  // of the soft zones; the hard ones are 5/4 as wide
  double jump = 100.0;
  double angle = 0.0;     // of the line
  double pressure = 1e9;  // holds the bodies together
};

// Two plates under pressure, the soft one above, sliding along the line; elastic.
inline Bodies plates(const Plates& p) {
  const Vec2 along = {std::cos(p.angle), std::sin(p.angle)};
  const auto turned = [along](Vec2 v) { return v.x * along + v.y * lagrange::left_of(along); };
  Mesh mesh(Symmetry::kPlane);
  const auto block = [&](double width, double from, double to) {
    const int nx = static_cast<int>(std::lround(p.length / width));
    const int ny = static_cast<int>(std::lround((to - from) / width));
    const auto flat = rectangle(nx, ny, {-0.5 * p.length, from}, {0.5 * p.length, to});
    mesh.add_block(nx, ny, [=](int i, int j) { return turned(flat(i, j)); });
  };
  block(p.width, 0.0, p.soft_depth);
  block(1.25 * p.width, -p.hard_depth, 0.0);
  Bodies bodies(mesh);
  const MieGrueneisen aluminium = aluminium_6061(), steel = steel_304();
  const auto compressed = [&p](const MieGrueneisen& m) {
    return root(m.density, 1.5 * m.density, [&](double rho) { return Eos(m).at(rho, 0.0).pressure - p.pressure; });
  };
  // The exact solutions are those of the paper's densities and moduli; under pressure the metal is denser, and its
  // modulus is chosen so that the impedance stays.
  const double soft_density = compressed(aluminium), hard_density = compressed(steel);
  bodies.materials.push_back(
      {.eos = Eos(aluminium), .strength = constant_yield(2703.0, 27.6e9 * 2703.0 / soft_density, 1e12)});
  bodies.materials.push_back(
      {.eos = Eos(steel), .strength = constant_yield(7900.0, 77e9 * 7900.0 / hard_density, 1e12)});
  fill(bodies, 0, soft_density, 0.0, p.jump * along);
  fill(bodies, 1, hard_density, 0.0, {});
  const lagrange::Block soft = bodies.mesh.blocks()[0], hard = bodies.mesh.blocks()[1];
  for (const Side side : {Side::kLeft, Side::kRight, Side::kTop}) bodies.loads.push_back({soft.side(side), p.pressure});
  for (const Side side : {Side::kLeft, Side::kRight, Side::kBottom})
    bodies.loads.push_back({hard.side(side), p.pressure});
  bodies.slide_lines.push_back({lagrange::surface(soft, Side::kBottom), lagrange::surface(hard, Side::kTop)});
  return bodies;
}

}  // namespace shearbus::test
