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
//   3. Below 1e-3 1/s, where the law was fitted to no data, the rate has no effect, so that a layer has a yield stress.
//   4. For r > 1 the argument of erf stays 0: thermal activation ends where the rate reaches the attempt rate.
//   5. tau is multiplied by 1 + 1e-9 min(ln r, 0). Where erf is 1 to its last digit and hardening has saturated, the
//      printed law has one stress for many rates; the factor keeps rate and strain functions of the stress.
//
// fault_of() accepts only constants with tau_s = tau_y = s0 r^beta for r >= 1: nothing hardens there and the inverse
// has a closed form. For r < 1 the kernel solves tau(ep + dep, r) = sqrt(3) a / (2 G0 g) for ln r, between the slowest
// rate and 1, by inverse Hermite interpolation, or by Newton's method where a branch of tau_s or tau_y ends, or by
// bisection where a step leaves the bracket. tau rises with ln r (tests/unit), so the root is unique. tau is computed
// from tau_y up, tau = tau_y + (d/p) ln(1 + (exp(x) - 1) (1 - exp(-...))), which cancels nothing. The loops over lanes
// have no branches, so that the compiler vectorises them.
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

  static constexpr double kSlowestRate = 1e-3;  // slowest rate  [1/s]; slower flow has the strength of this rate

  // Checks that the flow stress Y rises with strain and rate, falls with temperature, and follows the power law of
  // shocks, tau = s0 r^beta, for r >= 1.
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

  // The factor exp(-0.001 T/(T_melt - T)) is steepest at T = 0.9995 T_melt or, if the interval lacks this T, at the end
  // of the interval nearest to it.
  static double steepest_softening(const Material& m, double pressure, double coldest, double hottest) {
    const double c = kMeltingFactor * m.melting_temperature;
    const double nearest = std::max(0.0, m.melting_temperature - hottest);
    const double farthest = m.melting_temperature - coldest;
    const double stiffening = bracket_at(m, pressure);
    if (farthest <= 0.0 || stiffening <= 0.0) return 0.0;
    const double x = std::clamp(0.5 * c, nearest, farthest);
    const double melting = exponential(kMeltingFactor - c / x);  // melting factor exp(-0.001 T / x) at T = T_melt - x
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

  static constexpr double kRateSensitivity = 1e-9;  // tau is multiplied by 1 + this * min(ln r, 0)

  // The constants of the law for one step length, in the form that its kernels need.
  struct Constants {
    double inverse_unit, theta, p, inverse_p, s0, log_s0, s_range, y0, y_range, kappa, y1, y2, beta, inverse_beta,
        alpha;
    double log_attempts_in_step, slowest_strain, log_slowest;
  };
  static Constants constants_of(const Material& m, double dt) {
    const double p = std::max(m.work_hardening_curvature, kLeastCurvature), rate = attempts(m);
    return {.inverse_unit = 1.0 / unit_of_load(m),
            .theta = m.work_hardening_rate,
            .p = p,
            .inverse_p = 1.0 / p,
            .s0 = m.saturation_cold,
            .log_s0 = logarithm(m.saturation_cold),
            .s_range = m.saturation_cold - m.saturation_hot,
            .y0 = m.yield_cold,
            .y_range = m.yield_cold - m.yield_hot,
            .kappa = m.activation,
            .y1 = m.medium_rate_yield,
            .y2 = m.medium_rate_exponent,
            .beta = m.overdriven_exponent,
            .inverse_beta = 1.0 / m.overdriven_exponent,
            .alpha = m.modulus_temperature,
            .log_attempts_in_step = logarithm(rate * dt),
            .slowest_strain = kSlowestRate * dt,
            .log_slowest = logarithm(kSlowestRate / rate)};
  }
  PrestonTonksWallace(const Material& m, double dt) : c_(constants_of(m, dt)) {}

  double load_of(double a) const { return kSqrt3 * a * c_.inverse_unit; }
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
      const double inverse_g = 1.0 / (vertex.g > 0.0 ? vertex.g : 1.0);
      const double carried = loaded.load[l] * inverse_g + (vertex.g > 0.0 ? 0.0 : kMostTarget);
      const double least = carried > kLeastTarget ? carried : kLeastTarget;
      roots.target[l] = least < kMostTarget ? least : kMostTarget;
      roots.above_rest[l] = excess[l] * inverse_g;
      roots.T_hat[l] = vertex.T_hat;
      roots.log_scale[l] = vertex.log_scale;
      roots.lo[l] = vertex.log_slowest;
      roots.hi[l] = 0.0;
    }
    double any_near_rest = 0.0;
    for (int l = 0; l < N; ++l) {
      const double target = roots.target[l], above_rest = roots.above_rest[l];
      const double rest = target - above_rest;
      const double share = above_rest / (c_.s0 > rest ? c_.s0 - rest : 1.0);
      const double glides = roots.lo[l] * (1.0 - share);
      const double overdriven = (logarithm(target) - c_.log_s0) * c_.inverse_beta;
      const double yields = excess[l] > 0.0 ? 1.0 : 0.0;
      const double moves = target < c_.s0 ? yields : 0.0;
      roots.y[l] = target < c_.s0 ? glides : overdriven;
      roots.by_log_rate[l] = c_.beta * target;  // d tau/d ln(r) at r >= 1, where no search is needed
      roots.by_strain[l] = roots.by_T_hat[l] = roots.crept[l] = 0.0;
      roots.moves[l] = moves;
      roots.creeps[l] = above_rest <= c_.theta * c_.slowest_strain + kNearRest * target ? moves : 0.0;
      any_near_rest += roots.creeps[l];
    }
    if (any_near_rest > 0.0) creep(ep, roots);
    search(ep, roots);
    for (int l = 0; l < N; ++l) {
      const Slopes vertex = slopes_at(loaded.bracket[l], loaded.T_melt[l], loaded.T[l]);
      const double log_strain = roots.y[l] + roots.log_scale[l];
      const double searched = exponential(log_strain < kMostLogStrain ? log_strain : kMostLogStrain);
      const double dep = roots.creeps[l] > 0.0 ? roots.crept[l] : searched;
      const double rise = loaded.rise[l];
      // The differential of tau = sqrt(3) a/(2 G0 g) is tau (dlna - dlng) = by_log_rate (dln(dep) - dln(scale)) +
      // by_strain ddep + by_T_hat dT^, with dT = rise dlna and `scale` the dep at r = 1.
      const double by_dep = roots.by_log_rate[l] + roots.by_strain[l] * dep;
      const double pull = roots.target[l] * (1.0 - vertex.log_g * rise) +
                          roots.by_log_rate[l] * (0.5 * vertex.log_modulus * rise) -
                          roots.by_T_hat[l] * (rise * vertex.inverse_T_melt);
      const double least = kLeastSlope * roots.target[l];
      const double slope = dep * (pull / (by_dep > least ? by_dep : least));
      const bool yields = excess[l] > 0.0;
      take(l, yields ? dep : 0.0, yields ? slope : 0.0);
    }
  }

 private:
  static constexpr double kPi = 3.141592653589793;
  static constexpr double kAvogadro = 6.02214076e23;  // Avogadro constant  [1/mol]
  static constexpr double kLeastAttempts = 1.0;       // attempt rates gamma xi up to this one are refused  [1/s]
  // Largest alpha accepted. In hotter metal xi is smaller, so r is larger, which alone would raise the flow stress Y.
  // Up to this alpha Y falls with T nevertheless.
  static constexpr double kMostSoftening = 0.6;
  static constexpr double kMostCurvature = 100.0;   // largest p accepted, so that exp(p) is a moderate number
  static constexpr double kLeastCurvature = 1e-12;  // used for p = 0 (Voce's law): avoids 0/0, same tau
  static constexpr double kLeastTarget = 1e-300;    // a smaller target of tau is raised to this: ln is finite
  static constexpr double kMostTarget = 1e100;      // a larger target of tau is lowered to this value
  static constexpr double kMostLogStrain = 230.0;   // largest ln(dep), far above the strains of any host
  static constexpr double kLeastSlope = 1e-30;  // least d tau/d ln(dep), relative to tau, so that one can divide by it
  static constexpr double kNearRest = 1e-12;  // rounding error of tau, relative to the target, in the test for creep()
  static constexpr double kArrived = 1e-8;    // a Newton step of ln r shorter than this ends the search
  // A step of ln r by interpolation through two points has an error of about the square of (length of the step) *
  // (distance of the two points). The search ends if this product is at most kArrivedByTwo: the error is then below
  // rounding.
  static constexpr double kArrivedByTwo = 3e-8;
  // Longest step of ln r by interpolation that may end the search. Interpolation is used only where a change of ln r by
  // 3 kSmooth leaves every max() and min() in tau at the same argument.
  static constexpr double kSmooth = 3e-4;
  // Interpolation corrects Newton's step only if the correction is at most this multiple of the square of the step.
  static constexpr double kMostBend = 4.0;
  static constexpr double kRounding = 1e-15;  // rounding error of tau, relative to the target
  // After kNewtonIterations every second iteration bisects the bracket; usually 2 to 5 iterations are enough.
  static constexpr int kNewtonIterations = 12;
  static constexpr int kMostIterations = 150;

  // tau = Y / (2 G), with the flow stress Y before the melting factor, and its derivatives by ln r, ep and T^.
  struct Reduced {
    double stress, by_log_rate, by_strain, by_T_hat;
    double branch;  // code for the arguments that max() and min() select in tau_s and tau_y; NaN near a switch
  };

  // Properties of a vertex that depend on its temperature, but not on its load and strain.
  struct Vertex {
    double g;            // softening g = (G/G0) m, where m is the melting factor; 0 where molten
    double T_hat;        // relative temperature T/T_melt
    double log_scale;    // ln of the strain increment dep of the step at r = 1
    double log_slowest;  // ln r at the slowest rate, 1e-3 1/s
  };
  struct Slopes {
    double inverse_T_melt;  // 1 / T_melt  [1/K]
    double log_g;           // logarithmic slope dln(g)/dT      [1/K]
    double log_modulus;     // logarithmic slope dln(G)/dT      [1/K]
  };

  // The search for ln r at N vertices, and its results.
  template <int N>
  struct Roots {
    alignas(64) double target[N];      // value that tau must reach: sqrt(3) a / (2 G0 g)
    alignas(64) double above_rest[N];  // target less tau at the slowest rate and the strain before the step
    alignas(64) double T_hat[N];
    alignas(64) double log_scale[N];
    alignas(64) double lo[N];  // the root ln r lies between lo and hi
    alignas(64) double hi[N];
    alignas(64) double y[N];            // ln r, the unknown of the search
    alignas(64) double by_log_rate[N];  // derivative of the flow stress tau by ln r at the root
    alignas(64) double by_strain[N];
    alignas(64) double by_T_hat[N];
    alignas(64) double crept[N];   // strain increment dep of a vertex on which the rate has no effect
    alignas(64) double creeps[N];  // 1 where dep is `crept`; until creep() has decided, 1 where it may be
    alignas(64) double moves[N];   // 1 where the search goes on, else 0
  };

  // The attempt rate gamma xi at the modulus G0   [1/s]
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

  [[gnu::always_inline]] Vertex vertex_at(double bracket, double T_melt, double T) const {
    const double to_melting = T_melt - T;
    const double share = T / T_melt;
    const double T_hat = share < 1.0 ? share : 1.0;
    const double some_bracket = bracket > 0.0 ? bracket : 1.0;
    const double modulus = some_bracket * (1.0 - c_.alpha * T_hat);
    const double exponent = kMeltingFactor * T / (to_melting > 0.0 ? to_melting : T_melt);
    const double melting = modulus * exponential(-exponent);
    const double solid = to_melting > (kMeltingFactor / kExponentialRange) * T ? melting : 0.0;
    const double half_log = 0.5 * logarithm(modulus);
    return {bracket > 0.0 ? solid : 0.0, T_hat, c_.log_attempts_in_step + half_log, c_.log_slowest - half_log};
  }
  [[gnu::always_inline]] Slopes slopes_at(double bracket, double T_melt, double T) const {
    const double to_melting = bracket > 0.0 ? T_melt - T : 0.0;
    const bool solid = to_melting > 0.0;
    const double inverse_x = 1.0 / (solid ? to_melting : T_melt);
    const double log_modulus = solid ? -c_.alpha / (T_melt - c_.alpha * T) : 0.0;
    return {1.0 / T_melt, solid ? log_modulus - kMeltingFactor * T_melt * inverse_x * inverse_x : 0.0, log_modulus};
  }

  // The saturation stress tau_s and the yield stress tau_y at y = ln r, their derivatives by y and T^, and the
  // hardening between them.
  struct Branches {
    double tau_s, tau_y;
    double s_rate, y_rate;
    double s_T, y_T;
    double branch;   // code for the arguments that max() and min() select in tau_s and tau_y, as in Reduced
    double hardens;  // largest possible hardening: the smaller of tau_s - tau_y and d
    double d;        // scale of the hardening in Voce's law, s0 - tau_y
    double share;    // hardens / d; 1 if nothing hardens
  };
  [[gnu::always_inline]] Branches branches(double y, double T_hat) const {
    const double slower = y < 0.0 ? -y : 0.0;  // logarithm of 1/r; 0 if r > 1
    const double activated = c_.kappa * T_hat;
    const ErrorFunction erf = error_function(activated * slower);
    const double over = c_.s0 * exponential(c_.beta * y);
    const double medium = c_.y1 * exponential(c_.y2 * y);
    const double glide_s = c_.s0 - c_.s_range * erf.value;
    const double glide_y = c_.y0 - c_.y_range * erf.value;
    const double over_rate = c_.beta * over, medium_rate = c_.y2 * medium;
    const double fast_y = over < medium ? over : medium;
    const double fast_rate = over < medium ? over_rate : medium_rate;
    const double tau_s = over > glide_s ? over : glide_s;
    const double some_y = fast_y > glide_y ? fast_y : glide_y;
    const double tau_y = some_y < tau_s ? some_y : tau_s;
    const double erf_rate = y < 0.0 ? activated * erf.slope : 0.0;
    const double erf_T = -c_.kappa * slower * erf.slope;
    const double s_glides = c_.s_range * erf_rate, y_glides = c_.y_range * erf_rate;
    const double room = c_.s0 - tau_y;
    const double rise = tau_s - tau_y;
    const double hardens = rise < room ? rise : room;
    const double d = hardens > 0.0 ? room : 1.0;
    const double share = hardens > 0.0 ? hardens / d : 1.0;
    return {tau_s,
            tau_y,
            over > glide_s ? over_rate : s_glides,
            fast_y > glide_y ? fast_rate : y_glides,
            over > glide_s ? 0.0 : c_.s_range * erf_T,
            fast_y > glide_y ? 0.0 : c_.y_range * erf_T,
            branch_of(over - glide_s, over_rate + s_glides) + 3.0 * branch_of(fast_y - glide_y, fast_rate + y_glides) +
                9.0 * branch_of(over - medium, over_rate + medium_rate),
            hardens,
            d,
            share};
  }
  // The sign of the difference of two arguments of a max() or min(); NaN where it may change if ln r changes by
  // 3 kSmooth. `rates`: sum of the derivatives of both arguments by ln r.
  [[gnu::always_inline]] static double branch_of(double difference, double rates) {
    const double reach = 3.0 * kSmooth * rates;
    const double larger = difference > reach ? 1.0 : std::numeric_limits<double>::quiet_NaN();
    return difference < -reach ? -1.0 : larger;
  }

  // The flow stress tau at y = ln r, and its derivatives.
  [[gnu::always_inline]] Reduced reduced(double y, double ep, double T_hat) const {
    const double slower = y < 0.0 ? -y : 0.0;
    const Branches at = branches(y, T_hat);
    const bool hardens = at.hardens > 0.0;
    const double grown = exponential_minus_1(c_.p * at.share);
    const double strained = c_.p * c_.theta / (at.d * grown) * ep;
    const double gone = -exponential_minus_1(-strained);
    const double left = 1.0 - gone;
    const double sum = grown * gone;
    const double log_sum = logarithm_of_1_plus(sum);
    const double inverse_sum = 1.0 / (1.0 + sum);
    const double some_bend = gone - strained * left;
    const double bend = (1.0 + grown) * (some_bend > 0.0 ? some_bend : 0.0);
    const double by_s = hardens ? bend * inverse_sum : 1.0;
    const double less = grown * strained * left * c_.inverse_p - (1.0 - at.share) * bend;
    const double by_y = hardens ? 1.0 - log_sum * c_.inverse_p + less * inverse_sum : 0.0;
    const double stress = hardens ? at.tau_y + at.d * (log_sum * c_.inverse_p) : at.tau_s;
    const double by_rate = by_s * at.s_rate + by_y * at.y_rate;
    const double sensitive = 1.0 - kRateSensitivity * slower;
    return {stress * sensitive,
            (by_rate > 0.0 ? by_rate : 0.0) * sensitive + (y < 0.0 ? kRateSensitivity * stress : 0.0),
            hardens ? c_.theta * left * inverse_sum * sensitive : 0.0, (by_s * at.s_T + by_y * at.y_T) * sensitive,
            at.branch};
  }

  // Finds dep of the vertices that flow more slowly than kSlowestRate, that is, whose tau reaches the target within one
  // step at this rate. Their tau does not depend on the rate, so dep follows from the inverse of Voce's hardening.
  template <int N>
  [[gnu::always_inline]] void creep(const double* ep, Roots<N>& roots) const {
    for (int l = 0; l < N; ++l) {
      const double y = roots.lo[l], target = roots.target[l];
      const Reduced slow = reduced(y, ep[l] + c_.slowest_strain, roots.T_hat[l]);
      const Branches at = branches(y, roots.T_hat[l]);
      const double grown = exponential_minus_1(c_.p * at.share);
      const double wanted = target / (1.0 + kRateSensitivity * y) - at.tau_y;
      const double some_gone = exponential_minus_1(c_.p * (wanted / at.d)) / grown;
      const double gone = some_gone < kMostGone ? some_gone : kMostGone;
      const double risen = gone > 0.0 ? gone : 0.0;
      const double strain = logarithm_of_1_plus(risen / (1.0 - risen)) * (at.d * grown / (c_.p * c_.theta));
      const double flows = strain > ep[l] ? strain - ep[l] : 0.0;
      const double more = at.hardens > 0.0 ? flows : 0.0;
      const double creeps = slow.stress >= target ? roots.creeps[l] : 0.0;
      roots.crept[l] = more < c_.slowest_strain ? more : c_.slowest_strain;
      roots.y[l] = creeps > 0.0 ? y : roots.y[l];
      roots.by_log_rate[l] = creeps > 0.0 ? 0.0 : roots.by_log_rate[l];
      roots.by_strain[l] = creeps > 0.0 ? slow.by_strain : roots.by_strain[l];
      roots.by_T_hat[l] = creeps > 0.0 ? slow.by_T_hat : roots.by_T_hat[l];
      roots.moves[l] = creeps > 0.0 ? 0.0 : roots.moves[l];
      roots.creeps[l] = creeps;
    }
  }
  static constexpr double kMostGone = 1.0 - 0x1p-53;

  // Solves tau = target in ln r, lane by lane: a lane that has arrived keeps its root while its neighbours go on. The
  // first step is Newton's. A later step adds the correction of inverse Hermite interpolation: the cubic of ln r over
  // tau through the last two points and slopes, which is of order 2.7 if both points are on the same branches of tau.
  template <int N>
  [[gnu::always_inline]] void search(const double* ep, Roots<N>& roots) const {
    alignas(64) double last_y[N], last_missing[N], last_inverse[N], last_branch[N];
    for (int l = 0; l < N; ++l) {
      last_y[l] = last_missing[l] = last_inverse[l] = 0.0;
      last_branch[l] = std::numeric_limits<double>::quiet_NaN();
    }
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      double moving = 0.0;
      for (int l = 0; l < N; ++l) moving += roots.moves[l];
      if (moving == 0.0) break;
      const double bisects = iteration >= kNewtonIterations && iteration % 2 == 0 ? 1.0 : 0.0;
      for (int l = 0; l < N; ++l) {
        const bool moves = roots.moves[l] > 0.0;
        const double y = roots.y[l];
        const double dep = exponential(y + roots.log_scale[l]);
        const Reduced tau = reduced(y, ep[l] + dep, roots.T_hat[l]);
        const double missing = tau.stress - roots.target[l];
        const double lo = missing < 0.0 ? y : roots.lo[l];
        const double hi = missing < 0.0 ? roots.hi[l] : y;
        const double inverse = 1.0 / (tau.by_log_rate + tau.by_strain * dep);
        const double newton = -missing * inverse;
        const double apart = last_y[l] - y;
        const double span = last_missing[l] - missing;
        const double u = missing / (missing - last_missing[l]);
        const double a = span * inverse, b = span * last_inverse[l];
        const double bend = u * u * ((3.0 * apart - 2.0 * a - b) + u * ((a + b) - 2.0 * apart));
        const double smooth = tau.branch == last_branch[l] ? 1.0 : 0.0;
        const double mild = std::abs(bend) <= kMostBend * (newton * newton) ? smooth : 0.0;
        const double step = mild > 0.0 ? newton + bend : newton;
        const double tried = y + step;
        const double below = tried < hi ? 1.0 - bisects : 0.0;
        const double inside = tried > lo ? below : 0.0;
        const double next = inside > 0.0 ? tried : 0.5 * (lo + hi);
        const double size = std::abs(step);
        const double longest = mild > 0.0 ? kArrivedByTwo / (std::abs(apart) + kArrivedByTwo / kSmooth) : kArrived;
        const double met = std::abs(missing) <= kRounding * roots.target[l] ? 1.0 : 0.0;
        const double close = size <= longest ? inside : met;
        const double arrived = hi - lo <= -2.0 * kRounding * lo ? 1.0 : close;
        const double goes_on = arrived + met > 0.0 ? 0.0 : 1.0;
        const double stays = met > 0.0 ? y : next;
        last_y[l] = y;
        last_missing[l] = missing;
        last_inverse[l] = inverse;
        last_branch[l] = tau.branch;
        roots.lo[l] = moves ? lo : roots.lo[l];
        roots.hi[l] = moves ? hi : roots.hi[l];
        roots.y[l] = moves ? stays : y;
        roots.by_log_rate[l] = moves ? tau.by_log_rate : roots.by_log_rate[l];
        roots.by_strain[l] = moves ? tau.by_strain : roots.by_strain[l];
        roots.by_T_hat[l] = moves ? tau.by_T_hat : roots.by_T_hat[l];
        roots.moves[l] = moves ? goes_on : 0.0;
      }
    }
  }

  Constants c_;
};

}  // namespace shearbus::physics
