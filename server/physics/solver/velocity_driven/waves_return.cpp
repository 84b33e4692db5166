#include "server/physics/solver/velocity_driven/waves_return.hpp"

#include <algorithm>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/flow/root_search.hpp"

namespace shearbus::physics {
namespace {

constexpr double kTemperatureShare = 1e-6;  // of T, the difference that gives the derivative of the strength by T
constexpr double kSteepest = 1e30;          // largest hardening relative to sqrt(3) G0: a law's slope may be infinite

}  // namespace

LawReturn::LawReturn(const Material& soft, double pressure, double dt, double give)
    : soft_(soft), pressure_(pressure), dt_(dt), kappa_(kSqrt3 * soft.shear_modulus / give) {}

double LawReturn::strength(double ep, double dep, double T) const {
  return flow_stress(soft_, ep + dep, pressure_, T, dep / dt_) / kSqrt3;
}

ReturnedStress LawReturn::at(double ep, double trial, double T_ad, double rise) const {
  const auto T_of = [&](double dep) { return T_ad + rise * std::max(0.0, trial - kappa_ * dep); };
  const auto surplus = [&](double dep) { return strength(ep, dep, T_of(dep)) - std::max(0.0, trial - kappa_ * dep); };
  const double at_rest = surplus(0.0);
  if (at_rest >= 0.0) return {trial, 1.0, 0.0};
  const double most = trial / kappa_, at_most = strength(ep, most, T_ad);
  if (!(at_most > 0.0)) return {0.0, 0.0, 0.0};  // molten
  // The smaller of strain and stress is the unknown, in parts of the trial stress: the other one follows from it to the
  // last digits. Next to melting the strength magnifies an error of its own heat.
  const double at_half = surplus(0.5 * most);
  double dep = 0.0, T = 0.0, s = 0.0;
  if (at_half >= 0.0) {
    dep = zero_between(0.0, at_rest, 0.5 * most, at_half, trial, -1.0, surplus);
    T = T_of(dep);
    s = strength(ep, dep, T);
  } else {
    const auto beyond = [&](double a) { return a - strength(ep, (trial - a) / kappa_, T_ad + rise * a); };
    s = zero_between(0.0, -at_most, 0.5 * trial, -at_half, trial, at_most, beyond);
    dep = (trial - s) / kappa_;
    T = T_ad + rise * s;
  }
  const double warmer = T + kTemperatureShare * T;
  const double hardening = std::min(
      hardening_slope(soft_, ep, dep, dt_, pressure_, T) * softening(soft_, pressure_, T).g / (kSqrt3 * kappa_),
      kSteepest);
  const double softens = std::min(0.0, (strength(ep, dep, warmer) - s) / (warmer - T));
  return {std::min(s, trial), hardening / (1.0 + hardening - rise * softens), softens / (1.0 + hardening)};
}

double LawReturn::strain_under(double stress, double ep, double T, double most) const {
  const auto surplus = [&](double dep) { return strength(ep, dep, T) - stress; };
  const double at_rest = surplus(0.0), at_most = surplus(most);
  if (at_rest >= 0.0) return 0.0;
  if (at_most <= 0.0) return most;
  return zero_between(0.0, at_rest, most, at_most, stress, 0.5 * most, surplus);
}

}  // namespace shearbus::physics
