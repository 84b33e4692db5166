// A flow law for tests, Bingham's viscous metal. Its viscosity and its yield stress soften differently, so that rate
// and temperature are coupled:
//   Y(dep/dt, T) = (A + eta (1 - T/T_melt) dep/dt) (1 - T/T_melt), with yield stress A and viscosity eta
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <string_view>

#include "server/physics/material/flow_law.hpp"

namespace shearbus::physics {

class Bingham {
 public:
  static constexpr std::string_view kName = "bingham", kEquation = "Bingham 1922", kAdds = "viscosity", kWhen = "tests";
  // The constants of the law: the yield stress A [Pa], and the viscosity eta [Pa s] in the place of the hardening
  // modulus.
  static constexpr std::array kConstants = {&Material::yield_strength, &Material::hardening_modulus};
  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = false;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = false;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

  static LawFault fault_of(const Material&) { return {}; }
  static Softening softening(const Material& m, double /*pressure*/, double T) {
    if (!(T < m.melting_temperature)) return {};
    return {1.0 - T / m.melting_temperature, -1.0 / m.melting_temperature};
  }
  static double steepest_softening(const Material& m, double /*pressure*/, double /*coldest*/, double /*hottest*/) {
    return 1.0 / m.melting_temperature;
  }
  static double hardened(const Material& m, double /*ep*/, double rate, double pressure, double T) {
    return m.yield_strength + m.hardening_modulus * softening(m, pressure, T).g * rate;
  }
  static double hardening_slope(const Material& m, double /*ep*/, double /*dep*/, double dt, double P, double T) {
    return m.hardening_modulus * softening(m, P, T).g / dt;
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  Bingham(const Material& m, double dt) : A_(m.yield_strength), per_strain_(m.hardening_modulus / dt) {}

  double load_of(double a) const { return kSqrt3 * a / A_; }
  static double unit_of_load(const Material& m) { return m.yield_strength; }
  static double bracket_at(const Material&, double /*pressure*/) { return 1.0; }
  double strength_at_rest(double /*bracket*/, double T_melt, double T, double /*ep*/) const {
    return T < T_melt ? 1.0 - T / T_melt : 0.0;
  }
  template <int N, class Take>
  void flow(const LoadedVertices<N>& loaded, const double (&excess)[N], const double* /*ep*/, const Take& take) const {
    for (int l = 0; l < N; ++l) {
      const bool solid = loaded.T[l] < loaded.T_melt[l];
      const double g = solid ? 1.0 - loaded.T[l] / loaded.T_melt[l] : 1.0;
      const double dep = solid ? A_ * (loaded.load[l] / g - 1.0) / (per_strain_ * g) : 1e50;
      // relative decrease of the softening g = 1 - T/T_melt per increase of ln(stress)
      const double lost = loaded.rise[l] / (loaded.T_melt[l] * g);
      const double slope = solid ? A_ * loaded.load[l] * (1.0 + lost) / (per_strain_ * g * g) + dep * lost : 1e50;
      take(l, excess[l] > 0.0 ? dep : 0.0, excess[l] > 0.0 ? slope : 0.0);
    }
  }

 private:
  double A_, per_strain_;
};

}  // namespace shearbus::physics
