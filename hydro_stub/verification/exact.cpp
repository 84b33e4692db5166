#include "hydro_stub/verification/exact.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace shearbus::hydro {

double root(double low, double high, const std::function<double(double)>& f) {
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (f(middle) < 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double density_at(const lagrange::MieGrueneisen& metal, double pressure) {
  return root(0.9 * metal.density, 1.5 * metal.density,
              [&](double rho) { return lagrange::eos_from_density_energy(metal, rho, 0.0).pressure - pressure; });
}

TwoWaves two_waves(const Metal& metal, double velocity) {
  const lagrange::MieGrueneisen& m = metal.eos;
  const double yield = metal.strength.yield_strength;
  const double rho1 = m.density * std::exp(0.5 * yield / metal.strength.shear_modulus);
  const auto pressure = [&](double rho, double e) { return lagrange::eos_from_density_energy(m, rho, e).pressure; };
  const double shear = 2.0 * yield / 3.0;
  // The state behind the elastic wave has the stress S = P(rho1, e1) + 2Y/3 and the energy e1 = S (1/rho0 - 1/rho1)/2.
  const double strain1 = 0.5 * (1.0 / m.density - 1.0 / rho1);
  const double stress1 = root(0.0, 1e12, [&](double s) { return s - pressure(rho1, s * strain1) - shear; });
  TwoWaves w{};
  w.elastic_stress = stress1;
  w.elastic_velocity = std::sqrt(stress1 * 2.0 * strain1);
  w.elastic_speed = std::sqrt(stress1 / (2.0 * strain1)) / m.density;
  const double e1 = stress1 * strain1;
  // returns the stress on the plastic Hugoniot centred at the elastic limit, at density rho  [Pa]
  const auto behind = [&](double rho) {
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

Impact impact(const Metal& flyer, const Metal& target, double speed) {
  const double u = root(1e-3 * speed, (1.0 - 1e-3) * speed,
                        [&](double v) { return two_waves(target, v).stress - two_waves(flyer, speed - v).stress; });
  return {u, two_waves(target, u).stress};
}

namespace {

// Returns the integral of r^(d-1) ln(r_start/r) dr over the shell at rest, in d dimensions. The metal now at r started
// at r_start, where r_start^d = r^d + inner^d - stop^d because the shell is incompressible.
double strain_integral(double inner, double outer, double stop, int dimension) {
  const double d = dimension;
  const double moved = std::pow(inner, d) - std::pow(stop, d);
  const double outermost = std::pow(std::pow(outer, d) - moved, 1.0 / d);
  double sum = 0.0;
  constexpr int kParts = 4000;
  for (int i = 0; i < kParts; ++i) {
    const double r = stop + (outermost - stop) * (i + 0.5) / kParts;
    const double start = std::pow(std::pow(r, d) + moved, 1.0 / d);
    sum += std::pow(r, d - 1.0) * std::log(start / r);
  }
  return sum * (outermost - stop) / kParts;
}

}  // namespace

double cylinder_speed(const Metal& metal, double inner, double outer, double stop) {
  const double work =
      4.0 * metal.strength.yield_strength / std::numbers::sqrt3 * strain_integral(inner, outer, stop, 2);
  return std::sqrt(work / (metal.eos.density * inner * inner * std::log(outer / inner)));
}

double sphere_speed(const Metal& metal, double inner, double outer, double stop) {
  const double work = 4.0 * metal.strength.yield_strength * strain_integral(inner, outer, stop, 3);
  return std::sqrt(work / (metal.eos.density * inner * inner * inner * (1.0 - inner / outer)));
}

}  // namespace shearbus::hydro
