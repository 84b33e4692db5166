// Preston, Tonks, Wallace, J. Appl. Phys. 93 (2003) 211. In units of the shear modulus G(P, T), with Y = 2 G tau,
// T^ = T/T_melt and r = (dep/dt) / (gamma xi), where xi = 1/2 (4 pi rho / (3 M))^(1/3) (G / rho)^(1/2) is the rate at
// which a shear wave crosses an atom of mass M:
//
//   tau_s = max(s0 - (s0 - s_inf) erf(kappa T^ ln(1/r)), s0 r^beta)                           saturation
//   tau_y = max(y0 - (y0 - y_inf) erf(kappa T^ ln(1/r)), min(y1 r^y2, s0 r^beta))             yield
//   tau   = tau_s + (d/p) ln(1 - (1 - exp(-x)) exp(-p theta ep / (d (exp(x) - 1)))),
//           d = s0 - tau_y, x = p (tau_s - tau_y) / d                                         hardening, after Voce
//
// Departures from the paper:
//   1. Y is 0 at T_melt and above: Y = 2 G tau m(T) with m = exp(-0.001 T/(T_melt - T)) of DLP (15). m multiplies the
//      whole of Y; it enters neither r nor xi.
//   2. G(P, T) = G0 (1 + gP P) (1 - alpha T^). G0, the shear modulus of the body, is that of P = 0 and T = 0. The
//      elasticity of the layer keeps G0. rho in xi is the density at rest. So g(P, T) = (G/G0) m and H = 2 G0 tau.
//   3. Slower than 1e-3 1/s, where the law was fitted to no data, the rate has no effect: a layer has a yield stress.
//   4. For r > 1 the argument of erf stays 0: thermal activation ends where the rate reaches the attempt rate.
//   5. tau is multiplied by 1 + 1e-9 min(ln r, 0). Where erf is 1 to its last digit and hardening has saturated, the
//      printed law has one stress for many rates; this keeps rate and strain functions of the stress.
//
// The constants are such (fault_of) that tau_s = tau_y = s0 r^beta for r >= 1: nothing hardens there and the inverse is
// closed. For r < 1 the kernel solves tau(ep + dep, r) = sqrt(3) a / (2 G0 g) for ln r, between the slowest rate and 1,
// by Newton's method that bisects where a step leaves the bracket. tau rises with ln r (tests/unit), so the root is
// unique. tau is computed from tau_y up, tau = tau_y + (d/p) ln(1 + (exp(x) - 1) (1 - exp(-...))), which cancels nothing.
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

class PrestonTonksWallace {
 public:
  static constexpr std::string_view kName = "preston_tonks_wallace";
  static constexpr std::string_view kEquation = "Preston, Tonks, Wallace 2003";
  static constexpr std::string_view kAdds =
      "a flow stress whose rate and temperature are coupled, up to overdriven shocks";
  static constexpr std::string_view kWhen = "rates from 1e-3 to 1e12 1/s, where the rate matters";
  static constexpr std::array kConstants = {
      &Material::molar_mass,          &Material::work_hardening_rate,  &Material::work_hardening_curvature,
      &Material::saturation_cold,     &Material::saturation_hot,       &Material::yield_cold,
      &Material::yield_hot,           &Material::activation,           &Material::attempt_rate,
      &Material::medium_rate_yield,   &Material::medium_rate_exponent, &Material::overdriven_exponent,
      &Material::modulus_temperature, &Material::pressure_coefficient};

  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = false;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = true;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

  static constexpr double kSlowestRate = 1e-3;  // [1/s]; slower flow has the strength of this rate

  // What makes Y rise with strain and rate, fall with temperature and reach its overdriven branch at r = 1.
  static LawFault fault_of(const Material& m) {
    if (m.saturation_hot > m.saturation_cold)
      return {"saturation_stress_hot", "expected at most saturation_stress_cold"};
    if (m.yield_hot > m.yield_cold) return {"yield_stress_hot", "expected at most yield_stress_cold"};
    if (m.yield_cold > m.saturation_cold) return {"yield_stress_cold", "expected at most saturation_stress_cold"};
    if (m.yield_hot > m.saturation_hot) return {"yield_stress_hot", "expected at most saturation_stress_hot"};
    if (m.medium_rate_yield < m.saturation_cold)
      return {"medium_rate_yield_coefficient", "expected at least saturation_stress_cold"};
    if (m.medium_rate_exponent < m.overdriven_exponent)
      return {"medium_rate_yield_exponent", "expected at least overdriven_exponent"};
    if (m.medium_rate_exponent > 1.0) return {"medium_rate_yield_exponent", "expected at most 1"};
    if (m.activation > 1.0) return {"activation_coefficient", "expected at most 1"};
    if (m.modulus_temperature > kMostSoftening) return {"modulus_temperature_coefficient", "expected at most 0.6"};
    if (m.work_hardening_curvature > kMostCurvature) return {"work_hardening_curvature", "expected at most 100"};
    if (!(attempts(m) > kLeastAttempts))
      return {"attempt_rate_coefficient", "expected an attempt rate gamma xi above 1 per second"};
    return {};
  }

  static Softening softening(const Material& m, double pressure, double T) {
    const double stiffening = bracket_at(m, pressure);
    const double to_melting = m.melting_temperature - T;
    if (!(stiffening > 0.0) || !(to_melting > 0.0)) return {};
    const double exponent = kMeltingFactor * T / to_melting;
    if (!(exponent < kExponentialRange)) return {};
    const double melting = exponential(-exponent);
    const double melting_rate = kMeltingFactor * m.melting_temperature / (to_melting * to_melting);
    const double per_kelvin = m.modulus_temperature / m.melting_temperature;
    const double modulus = 1.0 - per_kelvin * T;
    return {stiffening * modulus * melting, -stiffening * melting * (per_kelvin + modulus * melting_rate)};
  }

  // As for Steinberg's law: the melting factor is steepest at a distance 0.0005 T_melt from melting, or at an end.
  static double steepest_softening(const Material& m, double pressure, double coldest, double hottest) {
    const double c = kMeltingFactor * m.melting_temperature;
    const double nearest = std::max(0.0, m.melting_temperature - hottest);
    const double farthest = m.melting_temperature - coldest;
    const double stiffening = bracket_at(m, pressure);
    if (farthest <= 0.0 || stiffening <= 0.0) return 0.0;
    const double x = std::clamp(0.5 * c, nearest, farthest);
    const double melting = exponential(kMeltingFactor - c / x);  // exp(-0.001 T / x) with T = T_melt - x
    const double per_kelvin = m.modulus_temperature / m.melting_temperature;
    return stiffening * (per_kelvin + (1.0 - per_kelvin * coldest) * melting * c / (x * x));
  }

  static double hardened(const Material& m, double ep, double rate, double pressure, double T) {
    return unit_of_load(m) * at(m, ep, rate, pressure, T).stress;
  }
  static double hardening_slope(const Material& m, double ep, double dep, double dt, double pressure, double T) {
    const double rate = dep / dt;
    const Reduced tau = at(m, ep + dep, rate, pressure, T);
    const double by_rate = rate > kSlowestRate ? tau.by_log_rate / dep : 0.0;
    return unit_of_load(m) * (tau.by_strain + by_rate);
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  PrestonTonksWallace(const Material& m, double dt)
      : inverse_unit_(1.0 / unit_of_load(m)),
        theta_(m.work_hardening_rate),
        p_(std::max(m.work_hardening_curvature, kLeastCurvature)),
        inverse_p_(1.0 / p_),
        s0_(m.saturation_cold),
        s_range_(m.saturation_cold - m.saturation_hot),
        y0_(m.yield_cold),
        y_range_(m.yield_cold - m.yield_hot),
        kappa_(m.activation),
        y1_(m.medium_rate_yield),
        y2_(m.medium_rate_exponent),
        beta_(m.overdriven_exponent),
        inverse_beta_(1.0 / m.overdriven_exponent),
        alpha_(m.modulus_temperature),
        attempts_in_step_(attempts(m) * dt),
        slowest_strain_(kSlowestRate * dt),
        log_slowest_(logarithm(kSlowestRate / attempts(m))) {}

  double load_of(double a) const { return kSqrt3 * a * inverse_unit_; }
  static double unit_of_load(const Material& m) { return 2.0 * m.shear_modulus; }
  static double bracket_at(const Material& m, double pressure) { return 1.0 + m.pressure_coefficient * pressure; }

  double strength_at_rest(double bracket, double T_melt, double T, double ep) const {
    const Vertex vertex = vertex_at(bracket, T_melt, T);
    return vertex.g * reduced(vertex.log_slowest, ep, vertex.T_hat).stress;
  }

  template <int N, class Take>
  [[gnu::always_inline]] void flow(const LoadedVertices<N>& loaded, const double (&excess)[N], const double* ep,
                                   const Take& take) const {
    Roots<N> roots;
    for (int l = 0; l < N; ++l) {
      const Vertex vertex = vertex_at(loaded.bracket[l], loaded.T_melt[l], loaded.T[l]);
      const double target = vertex.g > 0.0 ? loaded.load[l] / vertex.g : kMostTarget;
      roots.target[l] = target < kMostTarget ? target : kMostTarget;
      roots.T_hat[l] = vertex.T_hat;
      roots.scale[l] = vertex.scale;
      roots.lo[l] = vertex.log_slowest;
      roots.hi[l] = 0.0;
      begin(excess[l] > 0.0, ep[l], l, roots);
    }
    search(ep, roots);
    for (int l = 0; l < N; ++l) {
      const double log_strain = roots.y[l] + logarithm(roots.scale[l]);
      const double searched = exponential(log_strain < kMostLogStrain ? log_strain : kMostLogStrain);
      const double dep = roots.creeps[l] > 0.0 ? roots.crept[l] : searched;
      const Vertex vertex = vertex_at(loaded.bracket[l], loaded.T_melt[l], loaded.T[l]);
      const double rise = loaded.rise[l];
      // tau (dlna - dlng) = by_log_rate (dln(dep) - dln(scale)) + by_strain ddep + by_T_hat dT^, dT = rise dlna.
      const double by_dep = roots.by_log_rate[l] + roots.by_strain[l] * dep;
      const double pull = roots.target[l] * (1.0 - vertex.log_g_slope * rise) +
                          roots.by_log_rate[l] * (0.5 * vertex.log_modulus_slope * rise) -
                          roots.by_T_hat[l] * (rise * vertex.inverse_T_melt);
      const double least = kLeastSlope * roots.target[l];
      const double slope = dep * (pull / (by_dep > least ? by_dep : least));
      const bool yields = excess[l] > 0.0;
      take(l, yields ? dep : 0.0, yields ? slope : 0.0);
    }
  }

 private:
  static constexpr double kPi = 3.141592653589793;
  static constexpr double kAvogadro = 6.02214076e23;  // [1/mol]
  static constexpr double kLeastAttempts = 1.0;       // [1/s]
  static constexpr double kMostSoftening = 0.6;       // alpha: up to here Y falls with T through xi too
  static constexpr double kMostCurvature = 100.0;     // p: exp(p) stays a number
  static constexpr double kLeastCurvature = 1e-12;    // p = 0 is Voce's law: computed with this p, as close as rounding
  static constexpr double kRateSensitivity = 1e-9;    // departure 5
  static constexpr double kMostTarget = 1e100;        // of tau: dep is cut long before
  static constexpr double kMostLogStrain = 230.0;     // the strain is then beyond any host's, and finite
  static constexpr double kLeastSlope = 1e-30;        // of the target: a slope is no infinity
  static constexpr double kArrived = 1e-8;            // of ln r: the next Newton step is below rounding
  static constexpr double kRounding = 1e-15;          // of the target
  static constexpr int kNewtonIterations = 12;        // it takes 3 to 7; from then on every second step bisects
  static constexpr int kMostIterations = 150;

  // tau and its derivatives with respect to ln r, ep and T^.
  struct Reduced {
    double stress, by_log_rate, by_strain, by_T_hat;
  };

  // What a vertex at a temperature has, whatever its load and strain.
  struct Vertex {
    double g;                  // (G/G0) m; 0 where molten
    double T_hat;              // T/T_melt
    double inverse_T_melt;     // [1/K]
    double scale;              // dep of the step at r = 1
    double log_slowest;        // ln r at the slowest rate
    double log_g_slope;        // dln(g)/dT      [1/K]
    double log_modulus_slope;  // dln(G)/dT      [1/K]
  };

  // The roots of N vertices.
  template <int N>
  struct Roots {
    alignas(64) double target[N];  // tau
    alignas(64) double T_hat[N];
    alignas(64) double scale[N];
    alignas(64) double lo[N];  // bracket of ln r
    alignas(64) double hi[N];
    alignas(64) double y[N];            // ln r
    alignas(64) double by_log_rate[N];  // of tau there
    alignas(64) double by_strain[N];
    alignas(64) double by_T_hat[N];
    alignas(64) double crept[N];   // dep where the rate has no effect
    alignas(64) double creeps[N];  // 1 where the root is crept
    alignas(64) double moves[N];   // 1 where the search goes on
  };

  // gamma xi at G0   [1/s]
  static double attempts(const Material& m) {
    const double per_length = 4.0 * kPi * m.density * kAvogadro / (3.0 * m.molar_mass);
    return m.attempt_rate * 0.5 * power(per_length, 1.0 / 3.0) * std::sqrt(m.shear_modulus / m.density);
  }

  static Reduced at(const Material& m, double ep, double rate, double pressure, double T) {
    const PrestonTonksWallace law(m, 1.0);
    const double stiffening = std::max(bracket_at(m, pressure), std::numeric_limits<double>::min());
    const double T_hat = std::clamp(T / m.melting_temperature, 0.0, 1.0);
    const double scale = attempts(m) * std::sqrt(stiffening * (1.0 - m.modulus_temperature * T_hat));
    return law.reduced(logarithm(std::max(rate, kSlowestRate) / scale), ep, T_hat);
  }

  Vertex vertex_at(double bracket, double T_melt, double T) const {
    const double to_melting = T_melt - T;
    const bool solid = to_melting > 0.0 && bracket > 0.0;
    const double x = solid ? to_melting : T_melt;
    const double inverse_x = 1.0 / x;
    const double inverse_T_melt = 1.0 / T_melt;
    const double T_hat = solid ? T * inverse_T_melt : 1.0;
    const double softened = 1.0 - alpha_ * T_hat;
    const double modulus = (solid ? bracket : 1.0) * softened;
    const double exponent = kMeltingFactor * T * inverse_x;
    const double melting = exponent < kExponentialRange ? exponential(-exponent) : 0.0;
    const double log_modulus_slope = -alpha_ * inverse_T_melt / softened;
    const double half_log = 0.5 * logarithm(modulus);
    return {solid ? modulus * melting : 0.0,
            T_hat,
            inverse_T_melt,
            attempts_in_step_ * exponential(half_log),
            log_slowest_ - half_log,
            solid ? log_modulus_slope - kMeltingFactor * T_melt * inverse_x * inverse_x : 0.0,
            solid ? log_modulus_slope : 0.0};
  }

  // tau_s and tau_y at y = ln r, their derivatives with respect to y and T^, and what hardening makes of them.
  struct Branches {
    double tau_s, tau_y;
    double s_rate, y_rate;
    double s_T, y_T;
    bool hardens;
    double d;      // s0 - tau_y
    double share;  // (tau_s - tau_y) / d, at most 1
  };
  [[gnu::always_inline]] Branches branches(double y, double T_hat) const {
    const double slower = y < 0.0 ? -y : 0.0;  // ln(1/r)
    const ErrorFunction erf = error_function(kappa_ * T_hat * slower);
    const double over = s0_ * exponential(beta_ * y);
    const double medium = y1_ * exponential(y2_ * y);
    const double glide_s = s0_ - s_range_ * erf.value;
    const double glide_y = y0_ - y_range_ * erf.value;
    const double fast_y = over < medium ? over : medium;
    const double fast_slope = over < medium ? beta_ * over : y2_ * medium;
    const double tau_s = over > glide_s ? over : glide_s;
    const double some_y = fast_y > glide_y ? fast_y : glide_y;
    const double tau_y = some_y < tau_s ? some_y : tau_s;
    const double erf_rate = y < 0.0 ? kappa_ * T_hat * erf.slope : 0.0;
    const double erf_T = -kappa_ * slower * erf.slope;
    const bool hardens = tau_s > tau_y && s0_ > tau_y;
    const double d = hardens ? s0_ - tau_y : 1.0;
    const double share = hardens ? (tau_s - tau_y) / d : 1.0;
    return {tau_s,
            tau_y,
            over > glide_s ? beta_ * over : s_range_ * erf_rate,
            fast_y > glide_y ? fast_slope : y_range_ * erf_rate,
            over > glide_s ? 0.0 : s_range_ * erf_T,
            fast_y > glide_y ? 0.0 : y_range_ * erf_T,
            hardens,
            d,
            share < 1.0 ? share : 1.0};
  }

  // tau at y = ln r.
  [[gnu::always_inline]] Reduced reduced(double y, double ep, double T_hat) const {
    const double slower = y < 0.0 ? -y : 0.0;
    const Branches at = branches(y, T_hat);
    const double grown = exponential_minus_1(p_ * at.share);
    const double strained = p_ * theta_ / (at.d * grown) * ep;
    const double left = exponential(-strained);
    const double gone = -exponential_minus_1(-strained);
    const double log_sum = logarithm_of_1_plus(grown * gone);
    const double inverse_sum = 1.0 / (1.0 + grown * gone);
    const double some_bend = gone - strained * left;
    const double bend = some_bend > 0.0 ? some_bend : 0.0;
    const double by_s = at.hardens ? (1.0 + grown) * bend * inverse_sum : 1.0;
    const double less = grown * strained * left * inverse_p_ - (1.0 - at.share) * (1.0 + grown) * bend;
    const double by_y = at.hardens ? 1.0 - log_sum * inverse_p_ + less * inverse_sum : 0.0;
    const double stress = at.hardens ? at.tau_y + at.d * (log_sum * inverse_p_) : at.tau_s;
    const double by_rate = by_s * at.s_rate + by_y * at.y_rate;
    const double sensitive = 1.0 - kRateSensitivity * slower;
    return {stress * sensitive,
            (by_rate > 0.0 ? by_rate : 0.0) * sensitive + (y < 0.0 ? kRateSensitivity * stress : 0.0),
            at.hardens ? theta_ * left * inverse_sum * sensitive : 0.0, (by_s * at.s_T + by_y * at.y_T) * sensitive};
  }

  // The increment of strain that brings tau to `stress` at the slowest rate: the inverse of Voce's hardening.
  [[gnu::always_inline]] double creep(double stress, double y, double ep, double T_hat) const {
    const Branches at = branches(y, T_hat);
    const double grown = exponential_minus_1(p_ * at.share);
    const double wanted = stress / (1.0 + kRateSensitivity * y) - at.tau_y;
    const double some_gone = exponential_minus_1(p_ * (wanted / at.d)) / grown;
    const double gone = some_gone < kMostGone ? some_gone : kMostGone;
    const double risen = gone > 0.0 ? gone : 0.0;
    const double strain = logarithm_of_1_plus(risen / (1.0 - risen)) * (at.d * grown / (p_ * theta_));
    const double more = at.hardens && strain > ep ? strain - ep : 0.0;
    return more < slowest_strain_ ? more : slowest_strain_;
  }
  static constexpr double kMostGone = 1.0 - 0x1p-53;

  // Bracket and first guess of a vertex, or its root where that is closed.
  template <int N>
  [[gnu::always_inline]] void begin(bool yields, double ep, int l, Roots<N>& roots) const {
    const double target = roots.target[l];
    const double slowest = roots.lo[l];
    const Reduced slow = reduced(slowest, ep + slowest_strain_, roots.T_hat[l]);
    const bool overdriven = target >= s0_;
    const bool creeps = !overdriven && slow.stress >= target;
    const double share = (target - slow.stress) / (s0_ - slow.stress);
    const double between = slowest * (1.0 - share);
    const double over = logarithm((overdriven ? target : s0_) / s0_) * inverse_beta_;
    roots.y[l] = overdriven ? over : creeps ? slowest : between;
    roots.by_log_rate[l] = overdriven ? beta_ * target : 0.0;
    roots.by_strain[l] = overdriven ? 0.0 : slow.by_strain;
    roots.by_T_hat[l] = overdriven ? 0.0 : slow.by_T_hat;
    roots.creeps[l] = creeps ? 1.0 : 0.0;
    roots.moves[l] = yields && !overdriven && !creeps ? 1.0 : 0.0;
    roots.crept[l] = creep(target, slowest, ep, roots.T_hat[l]);
  }

  // Newton's method on tau - target in ln r, lane by lane: a lane that has arrived stays, whatever its neighbours do.
  template <int N>
  [[gnu::always_inline]] void search(const double* ep, Roots<N>& roots) const {
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      double moving = 0.0;
      for (int l = 0; l < N; ++l) moving += roots.moves[l];
      if (moving == 0.0) break;
      const bool bisects = iteration >= kNewtonIterations && iteration % 2 == 0;
      for (int l = 0; l < N; ++l) {
        const bool moves = roots.moves[l] > 0.0;
        const double y = roots.y[l];
        const double dep = roots.scale[l] * exponential(y);
        const Reduced tau = reduced(y, ep[l] + dep, roots.T_hat[l]);
        const double missing = tau.stress - roots.target[l];
        const double lo = missing < 0.0 ? y : roots.lo[l];
        const double hi = missing < 0.0 ? roots.hi[l] : y;
        const double newton = y - missing / (tau.by_log_rate + tau.by_strain * dep);
        const bool inside = newton > lo && newton < hi && !bisects;
        const double next = inside ? newton : 0.5 * (lo + hi);
        const bool met = std::abs(missing) <= kRounding * roots.target[l];
        const bool arrived = met || (inside && std::abs(next - y) <= kArrived) || hi - lo <= -2.0 * kRounding * lo;
        roots.lo[l] = moves ? lo : roots.lo[l];
        roots.hi[l] = moves ? hi : roots.hi[l];
        roots.y[l] = moves ? (met ? y : next) : y;
        roots.by_log_rate[l] = moves ? tau.by_log_rate : roots.by_log_rate[l];
        roots.by_strain[l] = moves ? tau.by_strain : roots.by_strain[l];
        roots.by_T_hat[l] = moves ? tau.by_T_hat : roots.by_T_hat[l];
        roots.moves[l] = moves && !arrived ? 1.0 : 0.0;
      }
    }
  }

  double inverse_unit_, theta_, p_, inverse_p_, s0_, s_range_, y0_, y_range_, kappa_, y1_, y2_, beta_, inverse_beta_,
      alpha_, attempts_in_step_, slowest_strain_, log_slowest_;
};

}  // namespace shearbus::physics
