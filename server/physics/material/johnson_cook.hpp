// Johnson, Cook, 7th Int. Symp. Ballistics, The Hague (1983) 541:
//
//   H(ep, r) = (A + B ep^n) (1 + C ln(max(r / r0, 1))),   r = dep/dt
//   g(T)     = 1 - T*^m,   T* = (T - T_ref) / (T_melt - T_ref), cut at 0 and 1
//
// A is the material's yield strength, n its hardening exponent. Pressure enters only through T_melt(P), if a scene asks
// for that. The rate is that of the step, dep/dt, and is solved for with the strain: with u = A + B (ep + dep)^n and x
// = ln(dep), u(x) (1 + C (x - ln(r0 dt))) is a rising convex function times a rising affine one, so it is convex and
// its root is unique. The search starts from a dep above the root, the smaller of two: the dep that would carry the
// stress without rate hardening, and the dep whose rate would carry the stress without strain hardening. Where the rate
// is below r0 the root has a closed form.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

class JohnsonCook {
 public:
  static constexpr std::string_view kName = "johnson_cook";
  static constexpr std::string_view kEquation = "Johnson, Cook 1983";
  static constexpr std::string_view kAdds = "a flow stress with its rate, solved with the strain";
  static constexpr std::string_view kWhen = "metals known by that law only";
  static constexpr std::array kConstants = {&Material::yield_strength,        &Material::hardening_modulus,
                                            &Material::hardening_exponent,    &Material::rate_coefficient,
                                            &Material::reference_strain_rate, &Material::thermal_exponent,
                                            &Material::reference_temperature};

  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = true;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = false;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

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

  // The slope |dg/dT| = m T*^(m-1) / (T_melt - T_ref) rises with T where m > 1 and falls where m < 1.
  static double steepest_softening(const Material& m, double /*pressure*/, double coldest, double hottest) {
    const double range = m.melting_temperature - m.reference_temperature;
    const double from = m.thermal_exponent < 1.0 ? coldest : hottest;
    const double share = std::clamp((from - m.reference_temperature) / range, kLeastShare, 1.0);
    if (hottest <= m.reference_temperature || coldest >= m.melting_temperature) return 0.0;
    return m.thermal_exponent * power(share, m.thermal_exponent - 1.0) / range;
  }

  static double hardened(const Material& m, double ep, double rate, double /*pressure*/, double /*T*/) {
    return static_strength(m, ep) * rate_factor(m, rate);
  }
  static double hardening_slope(const Material& m, double ep, double dep, double dt, double /*pressure*/,
                                double /*T*/) {
    const double strain = std::max(ep + dep, std::numeric_limits<double>::min());
    const double hardening = m.hardening_exponent * m.hardening_modulus * power(strain, m.hardening_exponent) / strain;
    const double rate = dep / dt;
    const double rate_hardening = rate > m.reference_strain_rate ? m.rate_coefficient / dep : 0.0;
    return hardening * rate_factor(m, rate) + static_strength(m, ep + dep) * rate_hardening;
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  // The stresses of the kernel are in units of the yield strength A.
  JohnsonCook(const Material& m, double dt)
      : yield_strength_(m.yield_strength),
        B_(m.hardening_modulus / m.yield_strength),
        inverse_B_(m.yield_strength / m.hardening_modulus),
        n_(m.hardening_exponent),
        inverse_n_(1.0 / m.hardening_exponent),
        C_(m.rate_coefficient),
        inverse_C_(m.rate_coefficient > 0.0 ? 1.0 / m.rate_coefficient : 0.0),
        log_slow_(m.rate_coefficient > 0.0 ? logarithm(m.reference_strain_rate * dt) : kNever),
        m_(m.thermal_exponent),
        T_ref_(m.reference_temperature) {}

  double load_of(double a) const { return logarithm(kSqrt3 * a / yield_strength_); }
  static double unit_of_load(const Material& m) { return m.yield_strength; }
  static double bracket_at(const Material&, double /*pressure*/) { return 1.0; }
  double log_strength(double ep) const { return logarithm(1.0 + B_ * power_of_strain(ep)); }

  SofteningExcess softening_excess(double /*bracket*/, double T_melt, double T) const {
    const double inverse_range = 1.0 / (T_melt - T_ref_);
    const double share = (T - T_ref_) * inverse_range;
    const bool softens = share > kLeastShare;
    const double within = share < 1.0 ? share : 0.5;
    const double safe = softens ? within : 0.5;
    const double lost = power(safe, m_);
    const double left = share < 1.0 ? 1.0 - lost : 0.0;
    const bool holds = left > 0.0;
    const double safe_left = holds ? left : 1.0;
    const double some_value = -logarithm(safe_left);
    const double some_rate = m_ * lost * inverse_range / (safe * safe_left);
    const double value = softens ? some_value : 0.0;
    const double rate = softens ? some_rate : 0.0;
    return {holds ? value : kMolten, rate};
  }

  template <int N, class Take>
  [[gnu::always_inline]] void flow(const double (&excess)[N], const double (&growth)[N], const double* ep,
                                   const Take& take) const {
    Roots<N> roots;
    const double rated = C_ > 0.0 ? 1.0 : 0.0;
    alignas(64) double rise[N];  // increase of ep^n that lets a vertex carry its stress without rate hardening
    for (int l = 0; l < N; ++l) {
      const double cut = excess[l] < kMaxExcess ? excess[l] : kMaxExcess;
      const bool yields = cut > 0.0;
      const double over = exponential_minus_1(yields ? cut : 1.0);
      const double at_rest = 1.0 + B_ * power_of_strain(ep[l]);
      rise[l] = at_rest * over * inverse_B_;
      roots.target[l] = at_rest + at_rest * over;
      const double unhardened = log_slow_ + over * inverse_C_;
      const double unrated = logarithm(some((roots.target[l] - 1.0) * inverse_B_)) * inverse_n_;
      const double above = unhardened < unrated ? unhardened : unrated;
      const double within = above < kMostLogStrain ? above : kMostLogStrain;
      roots.x[l] = within > log_slow_ ? within : log_slow_;
      roots.moves[l] = yields ? rated : 0.0;
      roots.dep[l] = roots.log_slope[l] = 1.0;
    }
    if (rated > 0.0) fall_to_root(ep, roots);
    double any_creeps = 0.0;
    for (int l = 0; l < N; ++l) {
      roots.creeps[l] = roots.x[l] <= log_slow_ ? 1.0 : 0.0;  // the search ended at its lower limit, the rate r0
      any_creeps += roots.creeps[l];
    }
    if (any_creeps > 0.0) flow_at_rest(ep, rise, roots);
    for (int l = 0; l < N; ++l) {
      const bool yields = excess[l] > 0.0;
      take(l, yields ? roots.dep[l] : 0.0, yields ? (1.0 + growth[l]) / roots.log_slope[l] : 0.0);
    }
  }

 private:
  static constexpr double kLeastShare = 1e-300;
  static constexpr double kMaxStrain = 1e100;
  static constexpr double kMostLogStrain = 230.0;
  static constexpr double kNever = 1e3;  // replaces ln(r0 dt) if C = 0; above any ln(dep), so the rate has no effect
  static constexpr double kLeastStrain = 1e-300;
  static constexpr int kMostIterations = 60;  // largest number of iterations; 2 to 5 are usual
  static constexpr double kConverged = 1e-5;  // a step of ln(dep) shorter than this ends the search
  // limit of Halley's correction `bend` of Newton's step: step / (1 - bend) is at most twice Newton's step
  static constexpr double kMostBend = 0.5;

  static double static_strength(const Material& m, double ep) {
    return m.yield_strength + (ep > 0.0 ? m.hardening_modulus * power(ep, m.hardening_exponent) : 0.0);
  }
  static double rate_factor(const Material& m, double rate) {
    return rate > m.reference_strain_rate ? 1.0 + m.rate_coefficient * logarithm(rate / m.reference_strain_rate) : 1.0;
  }

  double power_of_strain(double ep) const {
    const double there = ep > kLeastStrain ? 1.0 : 0.0;
    return there * power(ep > kLeastStrain ? ep : 1.0, n_);
  }

  static double some(double strain) {
    const double least = strain > kLeastStrain ? strain : kLeastStrain;
    return least < kMaxStrain ? least : kMaxStrain;
  }

  // The search for ln(dep) at N vertices, and its results.
  template <int N>
  struct Roots {
    alignas(64) double target[N];     // strength H, divided by A, with which the vertex just carries its stress
    alignas(64) double x[N];          // ln(dep), the unknown of the search
    alignas(64) double dep[N];        // plastic strain increment dep at the root
    alignas(64) double log_slope[N];  // derivative of ln(H) by dep at the root
    alignas(64) double moves[N];      // 1 where the search goes on, else 0
    alignas(64) double creeps[N];     // 1 where the strain rate does not harden (below r0, or C = 0), else 0
  };

  // Solves u w = target for x = ln(dep) by Halley's method, at each vertex by itself. The strain hardens by the factor
  // u = 1 + B (ep + dep)^n, the rate by the factor w = 1 + C (x - ln(r0 dt)). A vertex that has converged keeps its
  // root while others go on. Halley's method converges with third order: the error of a root is of the order of the
  // cube of the last step of x.
  template <int N>
  [[gnu::always_inline]] void fall_to_root(const double* ep, Roots<N>& roots) const {
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      double moving = 0.0;
      for (int l = 0; l < N; ++l) {
        const bool moves = roots.moves[l] > 0.0;
        const double x = roots.x[l];
        const double dep = exponential(x);
        const double strain = ep[l] + dep;
        const double share = dep / strain;  // fraction of the strain that is new in this step
        const double p = B_ * power(strain, n_);
        const double u = 1.0 + p, w = 1.0 + C_ * (x - log_slow_);
        const double u_1 = n_ * p * share;                    // derivative du/dx of the hardening u, with x = ln(dep)
        const double u_2 = u_1 * (1.0 + (n_ - 1.0) * share);  // its second derivative, by x = ln(dep)
        const double f = u * w - roots.target[l];
        const double f_1 = u_1 * w + u * C_;
        const double bend = 0.5 * f * (u_2 * w + 2.0 * C_ * u_1) / (f_1 * f_1);
        const double step = f / (f_1 * (1.0 - (bend < kMostBend ? bend : kMostBend)));
        const double inside = x - step > log_slow_ ? x - step : log_slow_;
        const double next = inside < kMostLogStrain ? inside : kMostLogStrain;
        // dep, u and w at the new x are extrapolated by Taylor series from their values at the old x, which saves
        // another exponential and power.
        const double along = x - next;
        const double dep_new = dep * (1.0 - along * (1.0 - 0.5 * along * (1.0 - along / 3.0)));
        const double u_new = u - u_1 * along, w_new = w - C_ * along;
        const double log_slope = (u_1 - u_2 * along) / (u_new * dep_new) + C_ / (w_new * dep_new);
        roots.dep[l] = moves ? dep_new : roots.dep[l];
        roots.log_slope[l] = moves ? log_slope : roots.log_slope[l];
        roots.x[l] = moves ? next : x;
        const double goes_on = std::abs(along) > kConverged ? 1.0 : 0.0;
        roots.moves[l] = roots.moves[l] * goes_on;
        moving += roots.moves[l];
      }
      if (moving == 0.0) break;
    }
  }

  // Finds dep where the rate does not harden. `rise` is the increase of ep^n that the stress demands, so that
  // dep = (ep^n + rise)^(1/n) - ep. For ep > 0 it is computed as ep ((1 + rise / ep^n)^(1/n) - 1), so that
  // nothing cancels.
  template <int N>
  [[gnu::always_inline]] void flow_at_rest(const double* ep, const double (&rise)[N], Roots<N>& roots) const {
    for (int l = 0; l < N; ++l) {
      const bool creeps = roots.creeps[l] > 0.0;
      const bool strained = ep[l] > kLeastStrain;
      const double before = power_of_strain(ep[l]);
      const double ratio = strained ? 1.0 + rise[l] / (strained ? before : 1.0) : rise[l];
      const double log_growth = logarithm(some(ratio)) * inverse_n_;
      const double flows = some(strained ? ep[l] * exponential_minus_1(log_growth) : exponential(log_growth));
      const double strain = ep[l] + flows;
      const double p = B_ * power(strain, n_);
      roots.dep[l] = creeps ? flows : roots.dep[l];
      roots.log_slope[l] = creeps ? n_ * p / (strain * (1.0 + p)) : roots.log_slope[l];
    }
  }

  double yield_strength_, B_, inverse_B_, n_, inverse_n_, C_, inverse_C_, log_slow_, m_, T_ref_;
};

}  // namespace shearbus::physics
