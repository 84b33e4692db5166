// Steinberg, Cochran, Guinan, J. Appl. Phys. 51 (1980) 1498, rate-independent, with the melting factor of Ball et al.:
//
//   H(ep)   = min(Y_max, Y0 (1 + beta ep)^n)                                        DLP (14), (40)
//   g(P, T) = (1 + gP P - hT (T - 300)) exp(-0.001 T / (T_melt - T))                DLP (15), (41)
//
// g is 0 where the bracket is not positive and at T_melt and above. The excess (flow_law.hpp) is
// log(sqrt(3) a / (Y0 g)) / n - log(1 + beta ep), so that DLP (48) is dep = (1/beta + ep) (exp(excess) - 1), in which
// nothing cancels. The kernel leaves out Y_max: solvers cap the stress.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

class SteinbergCochranGuinan {
 public:
  static constexpr std::string_view kName = "steinberg_cochran_guinan";
  static constexpr std::string_view kEquation = "DLP (14), (15)";
  static constexpr std::string_view kAdds = "hardening with strain, gain with pressure, softening with temperature";
  static constexpr std::string_view kWhen = "the default: metals at high rates, where the rate no longer matters";
  static constexpr std::array kConstants = {&Material::yield_strength,        &Material::yield_strength_max,
                                            &Material::hardening_coefficient, &Material::hardening_exponent,
                                            &Material::pressure_coefficient,  &Material::temperature_coefficient};

  static constexpr bool kDependsOnRate = false;
  static constexpr bool kSeparable = true;
  static constexpr bool kFirstOrderInTime = false;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = true;
  static constexpr bool kHasCeiling = true;
  static constexpr bool kHasWaveReturn = true;

  static constexpr double kReference = 300.0;      // reference temperature of the term hT (T - 300)  [K]
  static constexpr double kMeltingFactor = 0.001;  // the factor in exp(-0.001 T / (T_melt - T))

  static LawFault fault_of(const Material&) { return {}; }

  // Whether g is above 0. Costs less than g.
  static bool carries_stress(const Material& m, double pressure, double T) {
    const double bracket = 1.0 + m.pressure_coefficient * pressure - m.temperature_coefficient * (T - kReference);
    const double to_melting = m.melting_temperature - T;
    return bracket > 0.0 && to_melting > 0.0 && kMeltingFactor * T / to_melting < kExponentialRange;
  }
  static Softening softening(const Material& m, double pressure, double T) {
    if (!carries_stress(m, pressure, T)) return {};
    const double bracket = 1.0 + m.pressure_coefficient * pressure - m.temperature_coefficient * (T - kReference);
    const double to_melting = m.melting_temperature - T;
    const double melting = exponential(-kMeltingFactor * T / to_melting);
    const double melting_rate = kMeltingFactor * m.melting_temperature / (to_melting * to_melting);
    return {bracket * melting, -melting * (m.temperature_coefficient + bracket * melting_rate)};
  }

  // With x = T_melt - T and c = 0.001 T_melt the steep part of dg/dT goes as exp(-c/x)/x^2, largest at x = c/2.
  static double steepest_softening(const Material& m, double pressure, double coldest, double hottest) {
    const double c = kMeltingFactor * m.melting_temperature;
    const double nearest = std::max(0.0, m.melting_temperature - hottest);
    const double farthest = m.melting_temperature - coldest;
    if (farthest <= 0.0) return 0.0;
    const double x = std::clamp(0.5 * c, nearest, farthest);
    const double melting = exponential(kMeltingFactor - c / x);  // melting factor exp(-0.001 T / x) at T = T_melt - x
    const double bracket = 1.0 + m.pressure_coefficient * pressure - m.temperature_coefficient * (coldest - kReference);
    if (bracket <= 0.0) return 0.0;
    return m.temperature_coefficient + bracket * melting * c / (x * x);
  }

  static double hardened(const Material& m, double ep, double /*rate*/, double /*pressure*/, double /*T*/) {
    const double hardening = power(1.0 + m.hardening_coefficient * ep, m.hardening_exponent);
    return std::min(m.yield_strength_max, m.yield_strength * hardening);
  }
  static double hardening_slope(const Material& m, double ep, double dep, double /*dt*/, double /*pressure*/,
                                double /*T*/) {
    const double strength = hardened(m, ep + dep, 0.0, 0.0, 0.0);
    if (strength >= m.yield_strength_max) return 0.0;
    return strength * (m.hardening_exponent * m.hardening_coefficient / (1.0 + m.hardening_coefficient * (ep + dep)));
  }
  static double ceiling(const Material& m) {
    return hardens(m) ? m.yield_strength_max : std::min(m.yield_strength, m.yield_strength_max);
  }
  static bool hardens(const Material& m) { return m.hardening_coefficient > 0.0; }

  SteinbergCochranGuinan(const Material& m, double /*dt*/)
      : yield_strength_(m.yield_strength),
        exponent_(m.hardening_exponent),
        inverse_n_(1.0 / m.hardening_exponent),
        beta_(m.hardening_coefficient),
        inverse_beta_(1.0 / m.hardening_coefficient),
        hT_(m.temperature_coefficient) {}

  double load_of(double a) const { return logarithm(kSqrt3 * a / yield_strength_) / exponent_; }
  static double unit_of_load(const Material& m) { return m.yield_strength; }
  // Returns 1 + gP P + 300 hT. The bracket of the softening g is this value minus hT T.
  static double bracket_at(const Material& m, double pressure) {
    return 1.0 + m.pressure_coefficient * pressure + m.temperature_coefficient * kReference;
  }
  double log_strength(double ep) const { return logarithm(1.0 + beta_ * ep); }

  SofteningExcess softening_excess(double bracket_at_0, double T_melt, double T) const {
    const double to_melting = T_melt - T;
    const double bracket = bracket_at_0 - hT_ * T;
    const bool solid = to_melting > 0.0 && bracket > 0.0;
    const double x = solid ? to_melting : 1.0;
    const double b = solid ? bracket : 1.0;
    const double inverse_xb = 1.0 / (x * b);
    const double inverse_x = b * inverse_xb;
    const double value = inverse_n_ * (kMeltingFactor * T * inverse_x - logarithm(b));
    const double rate = inverse_n_ * (hT_ * x * inverse_xb + kMeltingFactor * T_melt * inverse_x * inverse_x);
    return {solid ? value : kMolten, rate};
  }

  template <int N, class Take>
  [[gnu::always_inline]] void flow(const double (&excess)[N], const double (&growth)[N], const double* ep,
                                   const Take& take) const {
    for (int l = 0; l < N; ++l) {
      const double cut = excess[l] < kMaxExcess ? excess[l] : kMaxExcess;
      const double hardened = inverse_beta_ + ep[l];
      const double flows = hardened * exponential_minus_1(cut);
      const bool yields = excess[l] > 0.0;
      take(l, yields ? flows : 0.0, yields ? (hardened + flows) * (inverse_n_ + growth[l]) : 0.0);
    }
  }

 private:
  double yield_strength_, exponent_, inverse_n_, beta_, inverse_beta_, hT_;
};

}  // namespace shearbus::physics
