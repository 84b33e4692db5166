// The flow stress as point functions (MODEL.md section 2): DLP (14-15), (40-41) with their guards.
#pragma once

#include <algorithm>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

inline constexpr double kSqrt3 = 1.7320508075688772;
inline constexpr double kSofteningReference = 300.0;  // of hT (T - 300)                       [K]
inline constexpr double kMeltingFactor = 0.001;       // of exp(-0.001 T / (T_melt - T)), Ball et al.

inline constexpr double kMeltingShare = 0.99;  // of T_melt: from here on an interface that yields is called melting

// eta = rho / rho0 on the principal Hugoniot at a pressure; 1 in tension. The density of any state at that pressure
// differs from it in the third order of the compression only.
double compression_at(const Material& m, double pressure);

// The material as it is at a pressure, both options worked into its constants: T_melt and gP are those there.
//   T_melt(P) = T_melt exp(2 a (1 - 1/eta)) eta^(2 (gamma0 - a - 1/3))      (Lindemann's law, as Steinberg gives it)
//   gP(P)     = gP / eta^(1/3)                                              (Steinberg, Cochran, Guinan 1980)
Material at_pressure(const Material& m, double pressure);

// g(P, T) = (1 + gP P - hT (T - 300)) exp(-0.001 T / (T_melt - T)) and its slope dg/dT. Zero where the bracket is not
// positive and at T_melt and above.
struct Softening {
  double g = 0.0;
  double slope = 0.0;
};

inline Softening softening(const Material& m, double pressure, double temperature) {
  if (m.varies_with_compression()) return softening(at_pressure(m, pressure), pressure, temperature);
  const double bracket =
      1.0 + m.pressure_coefficient * pressure - m.temperature_coefficient * (temperature - kSofteningReference);
  const double to_melting = m.melting_temperature - temperature;
  if (!(bracket > 0.0) || !(to_melting > 0.0)) return {};
  const double exponent = kMeltingFactor * temperature / to_melting;
  if (!(exponent < kExponentialRange)) return {};
  const double melting = exponential(-exponent);
  const double melting_rate = kMeltingFactor * m.melting_temperature / (to_melting * to_melting);
  return {bracket * melting, -melting * (m.temperature_coefficient + bracket * melting_rate)};
}

// Hardened strength before softening: min(Y_max, Y0 (1 + beta ep)^n).
inline double hardened_strength(const Material& m, double plastic_strain) {
  const double hardening = power(1.0 + m.hardening_coefficient * plastic_strain, m.hardening_exponent);
  return std::min(m.yield_strength_max, m.yield_strength * hardening);
}

// Y(ep, P, T) = min(Y_max, Y0 (1 + beta ep)^n) g(P, T)   [Pa]
inline double flow_stress(const Material& m, double plastic_strain, double pressure, double temperature) {
  return hardened_strength(m, plastic_strain) * softening(m, pressure, temperature).g;
}

// The largest hardened strength there is: Y_max, or Y0 where nothing hardens.
inline double strength_ceiling(const Material& m) {
  return m.hardening_coefficient > 0.0 ? m.yield_strength_max : std::min(m.yield_strength, m.yield_strength_max);
}

// beta_T = k sqrt(alpha_h) / (k sqrt(alpha_h) + k_h sqrt(alpha)): the share of the friction heat that enters `soft`
// (DLP 18-19).
double heat_partition(const Material& soft, const Material& hard);

}  // namespace shearbus::physics
