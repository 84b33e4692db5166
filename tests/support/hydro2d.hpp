// Materials, exact solutions and small helpers for the tests of the two-dimensional hydrocode.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"

namespace shearbus::test {

using lagrange::Bodies;
using lagrange::BodyMaterial;
using lagrange::Cycle;
using lagrange::Eos;
using lagrange::IdealGas;
using lagrange::Mesh;
using lagrange::MieGrueneisen;
using lagrange::Side;
using lagrange::Symmetry;
using lagrange::Vec2;
using lagrange::Wall;

// Constant flow stress, whatever the temperature.
inline physics::Material constant_yield(double density, double shear_modulus, double yield) {
  return {.density = density,
          .shear_modulus = shear_modulus,
          .yield_strength = yield,
          .hardening_exponent = 1.0,
          .melting_temperature = 1e15};
}

// Mie-Grueneisen constants (Steinberg, LLNL UCRL-MA-106439), strength as named.
inline MieGrueneisen aluminium_6061() {
  return {.density = 2703.0, .sound_speed = 5240.0, .s1 = 1.400, .gamma0 = 1.97, .specific_heat = 900.0};
}
inline MieGrueneisen steel_304() {
  return {.density = 7900.0, .sound_speed = 4570.0, .s1 = 1.490, .gamma0 = 1.93, .specific_heat = 500.0};
}

// The same state everywhere, per block.
inline void fill(Bodies& bodies, std::size_t block, double density, double energy, Vec2 velocity) {
  const lagrange::Block& b = bodies.mesh.blocks()[block];
  for (int z = 0; z < b.num_zones(); ++z) {
    bodies.density[b.first_zone + z] = density;
    bodies.energy[b.first_zone + z] = energy;
  }
  for (int n = 0; n < b.num_nodes(); ++n) bodies.velocity[b.first_node + n] = velocity;
}

// A rectangle of nx by ny zones from `low` to `high`.
inline std::function<Vec2(int, int)> rectangle(int nx, int ny, Vec2 low, Vec2 high) {
  return [=](int i, int j) { return Vec2{low.x + (high.x - low.x) * i / nx, low.y + (high.y - low.y) * j / ny}; };
}

// Hugoniot pressure and internal energy at a density, from e = P (1/rho0 - 1/rho)/2.
inline double hugoniot_pressure(const MieGrueneisen& m, double density) {
  const double n = 1.0 - m.density / density;
  const double d = 1.0 - n * (m.s1 + n * (m.s2 + n * m.s3));
  return m.density * m.sound_speed * m.sound_speed * n / (d * d);
}

// Root of an increasing function.
inline double root(double low, double high, const std::function<double(double)>& f) {
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (f(middle) < 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// A hypo-elastic, perfectly plastic metal driven at a velocity u: an elastic jump to the Hugoniot elastic limit, where
// the density is rho0 exp(Y/2G) (uniaxial strain Y/2G, deviator -2Y/3), and a plastic jump behind it.
struct TwoWaves {
  double elastic_stress, elastic_speed, elastic_velocity;
  double stress, plastic_speed, density;  // behind both waves; plastic_speed in the laboratory
};
inline TwoWaves two_waves(const MieGrueneisen& m, double shear_modulus, double yield, double velocity) {
  const double rho1 = m.density * std::exp(0.5 * yield / shear_modulus);
  const auto pressure = [&](double rho, double e) { return lagrange::eos_from_density_energy(m, rho, e).pressure; };
  const double shear = 2.0 * yield / 3.0;
  // Energy from e1 = s1 (1/rho0 - 1/rho1)/2, with s1 = P(rho1, e1) + 2Y/3.
  const double strain1 = 0.5 * (1.0 / m.density - 1.0 / rho1);
  const double stress1 = root(0.0, 1e12, [&](double s) { return s - pressure(rho1, s * strain1) - shear; });
  TwoWaves w{};
  w.elastic_stress = stress1;
  w.elastic_velocity = std::sqrt(stress1 * 2.0 * strain1);
  w.elastic_speed = std::sqrt(stress1 / (2.0 * strain1)) / m.density;
  const double e1 = stress1 * strain1;
  const auto behind = [&](double rho) {  // stress on the plastic Hugoniot centred at the elastic limit
    const double gap = 1.0 / rho1 - 1.0 / rho;
    return root(0.0, 1e13, [&](double s) { return s - pressure(rho, e1 + 0.5 * (s + stress1) * gap) - shear; });
  };
  w.density = root(rho1 * (1.0 + 1e-12), 1.6 * m.density, [&](double rho) {
    const double s = behind(rho);
    return w.elastic_velocity + std::sqrt(std::max(0.0, (s - stress1) * (1.0 / rho1 - 1.0 / rho))) - velocity;
  });
  w.stress = behind(w.density);
  w.plastic_speed = w.elastic_velocity + (w.stress - stress1) / (rho1 * (velocity - w.elastic_velocity));
  return w;
}

}  // namespace shearbus::test
