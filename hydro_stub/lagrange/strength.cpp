#include "hydro_stub/lagrange/strength.hpp"

#include <cmath>

namespace shearbus::lagrange {
namespace {

Deviator rotated(const Deviator& s, double spin, double dt) {
  const double t = 0.5 * spin * dt;  // tangent of half the angle of rotation
  const double scale = 1.0 / (1.0 + t * t);
  const double cosine = (1.0 - t * t) * scale;
  const double sine = 2.0 * t * scale;
  const double shear = 2.0 * sine * cosine * s.xy;
  const double cc = cosine * cosine;
  const double ss = sine * sine;
  return {cc * s.xx + ss * s.yy - shear, ss * s.xx + cc * s.yy + shear,
          sine * cosine * (s.xx - s.yy) + (cc - ss) * s.xy};
}

// The metal of a zone, with the zone's state before the step and the step length.
struct Zone {
  const physics::Material& metal;
  double g;  // softening g(pressure, temperature): a factor of the flow stress
  double plastic_strain;
  double pressure;     // [Pa]
  double temperature;  // [K]
  double dt;           // step length  [s]

  // Returns the flow stress after the plastic strain increment x, at the mean strain rate x/dt  [Pa].
  double yield(double x) const {
    return physics::hardened_strength(metal, plastic_strain + x, x / dt, pressure, temperature) * g;
  }
  double yield_slope(double x) const {
    return physics::hardening_slope(metal, plastic_strain, x, dt, pressure, temperature) * g;
  }
};

// Solves Y(ep + x, x/dt) + 3 G x = trial for the plastic strain increment x, with the flow stress Y at plastic strain
// and strain rate, the shear modulus G, and the equivalent stress `trial` of the trial deviator. The left side rises
// strictly. Newton's iterates are kept between 0 and the increment of perfect plasticity. Under concave hardening they
// rise from x = 0 to the root and do not pass the root.
double plastic_increment(const Zone& zone, double trial, double yield) {
  const physics::Material& metal = zone.metal;
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
    const double next = x + missing / (stiffness + zone.yield_slope(x));
    x = next > left && next <= right ? next : 0.5 * (left + right);
    strength = zone.yield(x);
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
  // 1. rotates the old deviator with the metal
  Deviator s = rotated(old, 0.5 * (d.yx - d.xy), dt);
  // 2. adds the elastic growth of the step, which gives the trial deviator
  const double stretch = 2.0 * metal.shear_modulus * dt;
  const double mean = d.dilatation() / 3.0;
  s.xx += stretch * (d.xx - mean);
  s.yy += stretch * (d.yy - mean);
  s.xy += stretch * 0.5 * (d.xy + d.yx);
  // 3. returns the trial deviator radially to the flow stress
  const double trial = equivalent_stress(s);
  if (trial == 0.0) return {s, 0.0};
  const Zone zone{metal, physics::softening(metal, pressure, temperature).g, plastic_strain, pressure, temperature, dt};
  const double yield = zone.yield(0.0);
  if (trial <= yield) return {s, 0.0};
  const double increment = plastic_increment(zone, trial, yield);
  const double keep = std::fmax(0.0, 1.0 - 3.0 * metal.shear_modulus * increment / trial);
  return {{keep * s.xx, keep * s.yy, keep * s.xy}, increment};
}

}  // namespace shearbus::lagrange
