// The stress that an interface can carry, and how accurately a step determines it.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/reference/parts.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// Bounds of a strength that softens with temperature, from a temperature 16 ulps hotter and 16 ulps colder. Near
// melting the strength is not known more accurately.
struct Limits {
  double lower, upper;
};

// Returns the bounds of the stress that the interface can carry, by friction, yield and junctions.
inline Limits interface_limits(const ModelOptions& options, const Answered& a, double size) {
  const InterfaceOptions& law = options.interface;
  const Material soft = at_pressure(options.soft, a.pressure);
  // Junctions harden with the slip, whose error is that of the jumps it is computed from.
  Limits strength{law.yield_strength, law.yield_strength};
  if (options.junctions) {
    const auto& [fraction, height, metal] = *options.junctions;
    const double grown = kDigits * size * a.dt / (kSqrt3 * height);
    const auto hardened = [&](double ep) { return SteinbergCochranGuinan::hardened(metal, ep, 0.0, 0.0, 0.0); };
    strength = {fraction * hardened(std::max(0.0, a.junction_strain - grown)),
                fraction * hardened(a.junction_strain + grown)};
  }
  const auto limit = [&](double yield, double T) {
    const double mu = reference::friction_coefficient(options, a.pressure, T, std::abs(a.slip));
    return std::min(mu * a.pressure, yield * softening(soft, a.pressure, T).g / kSqrt3);
  };
  return {limit(strength.lower, a.T0 * (1 + kDigits)) * (1 - 1e-10),
          limit(strength.upper, a.T0 * (1 - kDigits)) * (1 + 1e-10)};
}

// Returns the change of T0 by the heat of the last digit of the jumps [K]: negligible except for bodies of almost no
// mass.
inline double heat_grain(const ModelOptions& options, const Answered& a, double size) {
  const double flux = std::numeric_limits<double>::epsilon() * size * std::abs(a.stress);
  return flux * std::sqrt(options.soft.diffusivity * a.dt) / options.soft.conductivity;
}

// Returns whether stress and temperature determine the slip. Bodies of almost no mass reach jumps whose last digit
// melts the interface, or stresses below the change of strength by the last digit of T0; then the slip is not resolved.
inline bool is_resolved(const ModelOptions& options, const Answered& a, double size) {
  constexpr double kGrain = 1e-9;  // [K]
  constexpr double kShare = 1e-3;  // of the stress
  const Limits limit = interface_limits(options, a, size);
  return heat_grain(options, a, size) <= kGrain && limit.upper - limit.lower <= kShare * std::abs(a.stress);
}

}  // namespace shearbus::testing
