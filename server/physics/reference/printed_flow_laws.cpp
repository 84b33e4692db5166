// The flow laws as their papers print them, with the departures that each states: scalar references for the kernels in
// material/. The law of Steinberg, Cochran and Guinan is inverted by its closed form DLP (48), the others by bisection.
// The softening g of laws that do not couple rate and temperature is that of the kernels (strength.hpp).
#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {
namespace {

constexpr double kLeastLog = -690.0, kMostLog = 230.0;  // ln of the least and the largest strain increment searched
constexpr double kMostStrain = 1e100;

// Returns the strain increment dep with Y(dep) = sqrt(3) a: flow stress Y, which rises with dep, and shear stress a.
double increment_of(const std::function<double(double)>& yield, double a) {
  const auto missing = [&](double log_dep) { return yield(std::exp(log_dep)) - kSqrt3 * a; };
  if (missing(kLeastLog) >= 0.0) return 0.0;
  return missing(kMostLog) <= 0.0 ? kMostStrain : std::exp(bisect(missing, kLeastLog, kMostLog));
}

// The plastic strain increment of Steinberg's law under the shear stress a, DLP (48); g is the softening factor.
double steinberg(const Material& m, double a, double g, double ep_old) {
  const double hardened = std::pow(kSqrt3 * a / (m.yield_strength * g), 1.0 / m.hardening_exponent);
  return std::min(kMostStrain, std::max(0.0, (hardened - 1.0) / m.hardening_coefficient - ep_old));
}

double johnson_cook(const Material& m, double ep, double rate, double g) {
  const double rated = 1.0 + m.rate_coefficient * std::log(std::max(1.0, rate / m.reference_strain_rate));
  return (m.yield_strength + m.hardening_modulus * std::pow(ep, m.hardening_exponent)) * rated * g;
}

// Preston, Tonks and Wallace's law at one pressure and temperature, with the departures that
// material/preston_tonks_wallace.hpp states. The integrated hardening, which is a difference of numbers near 1, is
// computed in long double.
class Preston {
 public:
  Preston(const Material& m, double pressure, double T) : m_(m), T_hat_(T / m.melting_temperature) {
    constexpr double kPi = 3.141592653589793, kAvogadro = 6.02214076e23;
    const double rho = m.density, M = m.molar_mass / kAvogadro;
    const double G = m.shear_modulus * (1 + m.pressure_coefficient * pressure) * (1 - m.modulus_temperature * T_hat_);
    const double xi = 0.5 * std::cbrt(4 * kPi * rho / (3 * M)) * std::sqrt(G / rho);
    attempts_ = m.attempt_rate * xi;
    two_G_ = 2 * G * std::exp(-0.001 * T / (m.melting_temperature - T));
  }

  double yield(double ep, double rate) const {
    constexpr double kSlowest = 1e-3, kSensitivity = 1e-9;
    const double r = std::max(rate, kSlowest) / attempts_;
    const double activated = std::erf(m_.activation * T_hat_ * std::max(0.0, std::log(1 / r)));
    const double s0 = m_.saturation_cold, s_inf = m_.saturation_hot, y0 = m_.yield_cold, y_inf = m_.yield_hot;
    const double shock = s0 * std::pow(r, m_.overdriven_exponent);
    const double medium = m_.medium_rate_yield * std::pow(r, m_.medium_rate_exponent);
    const double tau_s = std::max(s0 - (s0 - s_inf) * activated, shock);
    const double tau_y = std::max(y0 - (y0 - y_inf) * activated, std::min(medium, shock));
    return two_G_ * hardened(tau_s, tau_y, ep) * (1 + kSensitivity * std::min(0.0, std::log(r)));
  }

 private:
  double hardened(double tau_s, double tau_y, double ep) const {
    const double theta = m_.work_hardening_rate, p = m_.work_hardening_curvature, d = m_.saturation_cold - tau_y;
    if (!(tau_s > tau_y && d > 0)) return tau_s;
    if (p == 0) return tau_s - (tau_s - tau_y) * std::exp(-theta * ep / (tau_s - tau_y));
    const long double x = p * static_cast<long double>(tau_s - tau_y) / d;
    const long double grown = std::exp(x);
    const long double left = std::exp(-p * theta * ep / (d * (grown - 1)));
    return static_cast<double>(tau_s + d / p * std::log(1 - (1 - 1 / grown) * left));
  }

  const Material& m_;
  double T_hat_;
  double attempts_ = 0.0;  // attempt rate gamma xi           [1/s]
  double two_G_ = 0.0;     // 2 G exp(-0.001 T/(T_melt - T))  [Pa]
};

}  // namespace

double strain_increment(const Material& m, double a, double pressure, double T, double ep_old, double dt) {
  if (a <= 0.0) return 0.0;
  const double g = softening(m, pressure, T).g;
  if (g <= 0.0) return kMostStrain;
  if (m.flow_law == FlowLaws::place<JohnsonCook>())
    return increment_of([&](double dep) { return johnson_cook(m, ep_old + dep, dep / dt, g); }, a);
  if (m.flow_law == FlowLaws::place<PrestonTonksWallace>()) {
    const Material now = at_pressure(m, pressure);
    const Preston law(now, pressure, T);
    return increment_of([&](double dep) { return law.yield(ep_old + dep, dep / dt); }, a);
  }
  if (m.flow_law == FlowLaws::place<SteinbergCochranGuinan>()) return steinberg(m, a, g, ep_old);
  throw std::logic_error("the twin does not know flow law " + std::string(FlowLaws::name_of(m.flow_law)));
}

}  // namespace shearbus::physics::reference
