// Materials, exact solutions and small helpers for the tests of the two-dimensional hydrocode.
#pragma once

#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/verification/problems.hpp"

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

// Returns a material with a constant flow stress, independent of temperature.
inline physics::Material constant_yield(double density, double shear_modulus, double yield) {
  return {.density = density,
          .shear_modulus = shear_modulus,
          .yield_strength = yield,
          .hardening_exponent = 1.0,
          .melting_temperature = 1e15};
}

// Mie-Grueneisen constants of the named alloys (Steinberg, LLNL UCRL-MA-106439).
inline MieGrueneisen aluminium_6061() {
  return {.density = 2703.0, .sound_speed = 5240.0, .s1 = 1.400, .gamma0 = 1.97, .specific_heat = 900.0};
}
inline MieGrueneisen steel_304() {
  return {.density = 7900.0, .sound_speed = 4570.0, .s1 = 1.490, .gamma0 = 1.93, .specific_heat = 500.0};
}

// Sets a uniform state in one block.
inline void fill(Bodies& bodies, std::size_t block, double density, double energy, Vec2 velocity) {
  const lagrange::Block& b = bodies.mesh.blocks()[block];
  for (int z = 0; z < b.num_zones(); ++z) {
    bodies.density[b.first_zone + z] = density;
    bodies.energy[b.first_zone + z] = energy;
  }
  for (int n = 0; n < b.num_nodes(); ++n) bodies.velocity[b.first_node + n] = velocity;
}

// Returns the node positions of a rectangle of nx by ny zones from `low` to `high`.
inline std::function<Vec2(int, int)> rectangle(int nx, int ny, Vec2 low, Vec2 high) {
  return [=](int i, int j) { return Vec2{low.x + (high.x - low.x) * i / nx, low.y + (high.y - low.y) * j / ny}; };
}

// Returns a perfectly plastic metal.
inline hydro::Metal plastic_metal(const MieGrueneisen& eos, double shear_modulus, double yield) {
  return {.eos = eos, .strength = constant_yield(eos.density, shear_modulus, yield)};
}

}  // namespace shearbus::test
