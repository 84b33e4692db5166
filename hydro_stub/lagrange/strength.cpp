#include "hydro_stub/lagrange/strength.hpp"

#include <cmath>

namespace shearbus::lagrange {
namespace {

Deviator rotated(const Deviator& s, double spin, double dt) {
  const double t = 0.5 * spin * dt;  // tangent of half the rotation angle
  const double scale = 1.0 / (1.0 + t * t);
  const double cosine = (1.0 - t * t) * scale;
  const double sine = 2.0 * t * scale;
  const double shear = 2.0 * sine * cosine * s.xy;
  const double cc = cosine * cosine;
  const double ss = sine * sine;
  return {cc * s.xx + ss * s.yy - shear, ss * s.xx + cc * s.yy + shear,
          sine * cosine * (s.xx - s.yy) + (cc - ss) * s.xy};
}

// Solves Y(ep + x, x/dt) + 3 G x = trial for the plastic strain increment x. The difference of the two sides is
// strictly monotonic. Newton's method is kept between 0 and the increment of perfect plasticity. For concave hardening
// the bounds are never active: the iterates rise from x = 0 to the root and cannot pass it.
double plastic_increment(const physics::Material& metal, double trial, double yield, double g, double plastic_strain,
                         double dt) {
  const double stiffness = 3.0 * metal.shear_modulus;
  double left = 0.0;
  double right = (trial - yield) / stiffness;
  if (!physics::hardens(metal)) return right;
  constexpr int kMostIterations = 200;
  constexpr double kConverged = 1e-13;
  double x = 0.0;
  double strength = yield;
  for (int i = 0; i < kMostIterations; ++i) {
    const double missing = trial - stiffness * x - strength;
    if (std::abs(missing) <= kConverged * trial) break;
    (missing > 0.0 ? left : right) = x;
    const double next = x + missing / (stiffness + physics::hardening_slope(metal, plastic_strain, x, dt) * g);
    x = next > left && next <= right ? next : 0.5 * (left + right);
    strength = physics::hardened_strength(metal, plastic_strain + x, x / dt) * g;
  }
  return x;
}

}  // namespace

double equivalent_stress(const Deviator& s) {
  const double zz = s.xx + s.yy;
  return std::sqrt(1.5 * (s.xx * s.xx + s.yy * s.yy + zz * zz + 2.0 * s.xy * s.xy));
}

StrengthStep advance_deviator(const physics::Material& metal, const Deviator& old, const Gradient& d, double dt,
                              double plastic_strain, double pressure, double temperature) {
  // 1. rotation
  Deviator s = rotated(old, 0.5 * (d.yx - d.xy), dt);
  // 2. elastic trial
  const double stretch = 2.0 * metal.shear_modulus * dt;
  const double mean = d.dilatation() / 3.0;
  s.xx += stretch * (d.xx - mean);
  s.yy += stretch * (d.yy - mean);
  s.xy += stretch * 0.5 * (d.xy + d.yx);
  // 3. radial return
  const double trial = equivalent_stress(s);
  if (trial == 0.0) return {s, 0.0};
  const double g = physics::softening(metal, pressure, temperature).g;
  const double yield = physics::hardened_strength(metal, plastic_strain) * g;
  if (trial <= yield) return {s, 0.0};
  const double increment = plastic_increment(metal, trial, yield, g, plastic_strain, dt);
  const double keep = std::fmax(0.0, 1.0 - 3.0 * metal.shear_modulus * increment / trial);
  return {{keep * s.xx, keep * s.yy, keep * s.xy}, increment};
}

}  // namespace shearbus::lagrange
