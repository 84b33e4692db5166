// The stress that an interface can carry, and how accurately a step determines it.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/reference/parts.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/melt_film.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// Bounds of a strength that softens with temperature: its values at temperatures 16 ulps above and below the given one.
// Near melting rounding errors of the temperature make the strength uncertain by this range.
struct Limits {
  double lower, upper;
};

// Returns the change of the interface temperature T0 [K] if the velocity jump, and so the friction heat, has a rounding
// error: four sums of terms as large as `size`, DLP (61) and the mean of the jumps, each rounded to half an ulp. The
// change matters only for bodies of almost no mass, which have enormous velocity jumps.
inline double heat_grain(const ModelOptions& options, const Answered& a, double size) {
  const double flux = 2.0 * std::numeric_limits<double>::epsilon() * size * std::abs(a.stress);
  return flux * std::sqrt(options.soft.diffusivity * a.dt) / options.soft.conductivity;
}

// Returns the bounds of the stress that the interface can carry. Friction and the yield strength of the interface, or
// of its junctions, limit the stress. The rounding errors of the velocity jumps are proportional to `size`, the
// magnitude of the jumps [m/s].
inline Limits interface_limits(const ModelOptions& options, const Answered& a, double size) {
  const InterfaceOptions& law = options.interface;
  const Material soft = at_pressure(options.soft, a.pressure);
  // Junctions harden with the slip, which has the rounding error of the velocity jumps.
  Limits strength{law.yield_strength, law.yield_strength};
  if (options.junctions) {
    const auto& [fraction, height, metal] = *options.junctions;
    const double grown = kDigits * size * a.dt / (kSqrt3 * height);
    const auto hardened = [&law_of = metal](double ep) {
      return SteinbergCochranGuinan::hardened(law_of, ep, 0.0, 0.0, 0.0);
    };
    strength = {fraction * hardened(std::max(0.0, a.junction_strain - grown)),
                fraction * hardened(a.junction_strain + grown)};
  }
  // Friction may depend on the slip, which has that error, too.
  const bool has_state = options.strategy == Strategy::kForceDriven && !states_of(law.friction_law).empty();
  const double seen = a.jump_old + a.plastic_drive, free = seen + a.driven, along = free < 0.0 ? -1.0 : 1.0;
  const double rest = !has_state ? 0.0  // no least slip in its law
                      : options.inertia
                          ? physics::kAtRest * (std::abs(a.jump_old) + a.plastic_drive_size + a.driven_size)
                          : reference::least_slip_of_law(along * seen, std::abs(free));
  const double slip = std::max(std::abs(a.slip), rest), less = std::max(0.0, slip - kDigits * size),
               more = slip + kDigits * size;
  const auto friction = [&](double T, double v) {
    return reference::friction_of(options, a.pressure, T, v, a.dt, a.friction_state);
  };
  const auto limit = [&](double yield, double T, double rubbing) {
    const double g = options.melt_film ? solid_softening(soft, a.pressure, T) : softening(soft, a.pressure, T).g;
    return std::min(rubbing, yield * g / kSqrt3);
  };
  const double grain = heat_grain(options, a, size);
  const double hot = a.T0 * (1 + kDigits) + grain, cold = std::max(0.0, a.T0 * (1 - kDigits) - grain);
  const double least = std::min(friction(hot, less), friction(hot, more));
  const double most = std::max(friction(cold, less), friction(cold, more));
  return {limit(strength.lower, hot, least) * (1 - 1e-10), limit(strength.upper, cold, most) * (1 + 1e-10)};
}

// Returns true if the slip is determined despite rounding errors. It is not determined if a rounding error of the
// velocity jump changes T0 noticeably, or if a rounding error of T0 changes the strength by a noticeable part of the
// stress. Both occur for bodies of almost no mass.
inline bool is_resolved(const ModelOptions& options, const Answered& a, double size) {
  // largest change of T0 by a rounding error of the jump at which the slip still counts as determined  [K]
  constexpr double kGrain = 2e-9;
  // largest change of the strength by rounding errors at which the slip still counts as determined, over the stress
  constexpr double kShare = 1e-3;
  const Limits limit = interface_limits(options, a, size);
  return heat_grain(options, a, size) <= kGrain && limit.upper - limit.lower <= kShare * std::abs(a.stress);
}

}  // namespace shearbus::testing
