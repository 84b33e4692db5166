// Johnson, Cook, 7th Int. Symp. Ballistics, The Hague (1983) 541:
//
//   H(ep, r) = (A + B ep^n) (1 + C ln(max(r / r0, 1))),   r = dep/dt
//   g(T)     = 1 - T*^m,   T* = (T - T_ref) / (T_melt - T_ref), cut at 0 and 1
//
// A is the material's yield strength, n its hardening exponent. Pressure does not enter, but through T_melt(P) where a
// scene asks for that. The rate is that of the step, dep/dt, and is solved for with the strain: with u = A + B (ep +
// dep)^n and x = ln(dep), u(x) (1 + C (x - ln(r0 dt))) is a rising convex function times a rising affine one, so it is
// convex, its root is unique and Newton's method falls to it from any point above. Such points are the strain that
// would do without the rate and the rate that would do without hardening. Slower than r0 the root is closed.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

class JohnsonCook {
 public:
  static constexpr std::string_view kName = "johnson_cook";
  static constexpr std::array kConstants = {&Material::yield_strength,        &Material::hardening_modulus,
                                            &Material::hardening_exponent,    &Material::rate_coefficient,
                                            &Material::reference_strain_rate, &Material::thermal_exponent,
                                            &Material::reference_temperature};

  static LawFault fault_of(const Material& m) {
    if (m.reference_temperature < m.melting_temperature) return {};
    return {"reference_temperature_k", "expected below the melting temperature"};
  }

  static Softening softening(const Material& m, double /*pressure*/, double T) {
    const double range = m.melting_temperature - m.reference_temperature;
    const double share = (T - m.reference_temperature) / range;
    if (!(share < 1.0)) return {};
    if (share <= kLeastShare) return {1.0, 0.0};
    const double lost = power(share, m.thermal_exponent);
    return {1.0 - lost, -m.thermal_exponent * lost / (share * range)};
  }

  // |dg/dT| = m T*^(m-1) / (T_melt - T_ref) rises with T where m > 1 and falls where m < 1.
  static double steepest_softening(const Material& m, double /*pressure*/, double coldest, double hottest) {
    const double range = m.melting_temperature - m.reference_temperature;
    const double from = m.thermal_exponent < 1.0 ? coldest : hottest;
    const double share = std::clamp((from - m.reference_temperature) / range, kLeastShare, 1.0);
    if (hottest <= m.reference_temperature || coldest >= m.melting_temperature) return 0.0;
    return m.thermal_exponent * power(share, m.thermal_exponent - 1.0) / range;
  }

  static double hardened(const Material& m, double ep, double rate) {
    return static_strength(m, ep) * rate_factor(m, rate);
  }
  static double hardening_slope(const Material& m, double ep, double dep, double dt) {
    const double strain = std::max(ep + dep, std::numeric_limits<double>::min());
    const double hardening = m.hardening_exponent * m.hardening_modulus * power(strain, m.hardening_exponent) / strain;
    const double rate = dep / dt;
    const double rate_hardening = rate > m.reference_strain_rate ? m.rate_coefficient / dep : 0.0;
    return hardening * rate_factor(m, rate) + static_strength(m, ep + dep) * rate_hardening;
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  // Everything in units of A.
  JohnsonCook(const Material& m, double dt)
      : yield_strength_(m.yield_strength),
        B_(m.hardening_modulus / m.yield_strength),
        n_(m.hardening_exponent),
        inverse_n_(1.0 / m.hardening_exponent),
        C_(m.rate_coefficient),
        inverse_C_(m.rate_coefficient > 0.0 ? 1.0 / m.rate_coefficient : 0.0),
        log_slow_(m.rate_coefficient > 0.0 ? logarithm(m.reference_strain_rate * dt) : kNever),
        m_(m.thermal_exponent),
        T_ref_(m.reference_temperature) {}

  double log_load(double a) const { return logarithm(kSqrt3 * a / yield_strength_); }
  static double bracket_at(const Material&, double /*pressure*/) { return 1.0; }
  double log_strength(double ep) const { return logarithm(1.0 + B_ * power_of_strain(ep)); }

  SofteningExcess softening_excess(double /*bracket*/, double T_melt, double T) const {
    const double inverse_range = 1.0 / (T_melt - T_ref_);
    const double share = (T - T_ref_) * inverse_range;
    const bool softens = share > kLeastShare;
    const bool solid = share < 1.0;
    const double safe = softens && solid ? share : 0.5;
    const double lost = power(safe, m_);
    const double left = 1.0 - lost;
    const bool holds = solid && left > 0.0;
    const double safe_left = left > 0.0 ? left : 1.0;
    const double value = softens ? -logarithm(safe_left) : 0.0;
    const double rate = softens ? m_ * lost * inverse_range / (safe * safe_left) : 0.0;
    return {holds ? value : kMolten, rate};
  }

  template <int N>
  [[gnu::always_inline]] void flow(const double (&excess)[N], const double (&growth)[N], const double* ep,
                                   double (&dep)[N], double (&slope)[N]) const {
    alignas(64) double target[N];  // sqrt(3) a / (A g)
    alignas(64) double slow[N];    // dep at the strength of rest
    alignas(64) double x[N];       // ln(dep)
    alignas(64) double moves[N];   // 1 where the rate takes part, else 0
    double any_moves = 0.0;
    for (int l = 0; l < N; ++l) {
      const double cut = excess[l] < kMaxExcess ? excess[l] : kMaxExcess;
      const bool yields = cut > 0.0;
      const double over = exponential_minus_1(yields ? cut : 1.0);
      const double before = power_of_strain(ep[l]);
      const double at_rest = 1.0 + B_ * before;
      target[l] = at_rest + at_rest * over;
      slow[l] = flow_at_rest(ep[l], before, at_rest * over / B_);
      const double unrated = logarithm(slow[l]);
      const double unhardened = log_slow_ + over * inverse_C_;
      moves[l] = yields && unrated > log_slow_ ? 1.0 : 0.0;
      x[l] = moves[l] > 0.0 && unhardened < unrated ? unhardened : unrated;
      any_moves += moves[l];
    }
    if (any_moves > 0.0) fall_to_root(target, ep, moves, x);
    for (int l = 0; l < N; ++l) {
      const bool yields = excess[l] > 0.0;
      const bool rated = yields && logarithm(slow[l]) > log_slow_;
      const double flows = rated ? exponential(x[l]) : slow[l];
      const Balance at = balance(ep[l], flows, x[l]);
      const double log_slope = at.hardening / at.u + (rated ? C_ / (at.w * flows) : 0.0);  // of u w with dep
      dep[l] = yields ? flows : 0.0;
      slope[l] = yields ? (1.0 + growth[l]) / log_slope : 0.0;
    }
  }

 private:
  static constexpr double kLeastShare = 1e-300;
  static constexpr double kMaxStrain = 1e100;
  static constexpr double kNever = 1e3;  // ln of a strain beyond the largest
  static constexpr double kLeastStrain = 1e-300;
  static constexpr int kMostIterations = 60;  // it takes 3 to 8
  static constexpr double kConverged = 1e-9;  // of ln(dep): the next Newton step is below rounding

  static double static_strength(const Material& m, double ep) {
    return m.yield_strength + (ep > 0.0 ? m.hardening_modulus * power(ep, m.hardening_exponent) : 0.0);
  }
  static double rate_factor(const Material& m, double rate) {
    return rate > m.reference_strain_rate ? 1.0 + m.rate_coefficient * logarithm(rate / m.reference_strain_rate) : 1.0;
  }

  double power_of_strain(double ep) const {
    const double value = power(ep > kLeastStrain ? ep : 1.0, n_);
    return ep > kLeastStrain ? value : 0.0;
  }

  // (ep^n + rise)^(1/n) - ep, as a ratio where there is strain already, so that nothing cancels.
  double flow_at_rest(double ep, double power_of_ep, double rise) const {
    const bool strained = ep > kLeastStrain;
    const double ratio = strained ? 1.0 + rise / (strained ? power_of_ep : 1.0) : rise;
    const double above = ratio > kLeastStrain ? ratio : kLeastStrain;
    const double log_growth = logarithm(above < kMaxStrain ? above : kMaxStrain) * inverse_n_;
    const double flows = strained ? ep * exponential_minus_1(log_growth) : exponential(log_growth);
    const double some = flows > kLeastStrain ? flows : kLeastStrain;
    return some < kMaxStrain ? some : kMaxStrain;
  }

  struct Balance {
    double u;          // (A + B (ep + dep)^n) / A
    double hardening;  // du/d(dep)
    double w;          // 1 + C (x - ln(r0 dt))
  };
  [[gnu::always_inline]] Balance balance(double ep, double dep, double x) const {
    const double strain = ep + dep;
    const double p = B_ * power(strain, n_);
    return {1.0 + p, n_ * p / strain, 1.0 + C_ * (x - log_slow_)};
  }

  // Newton on u w - target, lane by lane: a lane that has arrived stays, whatever its neighbours still do.
  template <int N>
  [[gnu::always_inline]] void fall_to_root(const double (&target)[N], const double* ep, double (&moves)[N],
                                           double (&x)[N]) const {
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      double moving = 0.0;
      for (int l = 0; l < N; ++l) {
        const double dep = exponential(x[l]);
        const Balance at = balance(ep[l], dep, x[l]);
        const double step = (at.u * at.w - target[l]) / (at.hardening * dep * at.w + at.u * C_);
        const double next = x[l] - step;
        const double kept = next > log_slow_ ? next : 0.5 * (x[l] + log_slow_);  // rounding must not lead below r0 dt
        const bool far = (step > kConverged || step < -kConverged) && kept != x[l];
        x[l] = moves[l] > 0.0 ? kept : x[l];
        moves[l] = far ? moves[l] : 0.0;
        moving += moves[l];
      }
      if (moving == 0.0) break;
    }
  }

  double yield_strength_, B_, n_, inverse_n_, C_, inverse_C_, log_slow_, m_, T_ref_;
};

}  // namespace shearbus::physics
