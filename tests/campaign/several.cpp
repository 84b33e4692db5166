// Finds force-driven steps of a physics that have several solutions.
#include <algorithm>

#include "server/physics/layer/modes.hpp"
#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs of tests/support

namespace {

constexpr double kLongestStep = 1e-5;  // longest step of the campaign  [s]
constexpr double kStickShare = 0.9;    // stress of the sticking solution, relative to the stress limit before the step
// Two slipping solutions count as clearly apart if the stress limit, at the slip that heats most, is below this share
// of the stress that belongs to that slip.
constexpr double kClearly = 0.8;

// Returns the stress limit of the interface at the temperature T  [Pa].
double limit_at(const ModelOptions& o, double pressure, const Material& soft, double T) {
  return std::min(o.interface.friction_coefficient * pressure,
                  o.interface.yield_strength * softening(soft, pressure, T).g / kSqrt3);
}

}  // namespace

// The slip velocity [v] of a step decreases with the stress s: [v] = c - b s. The interface can stick at s = c/b. The
// stress s = c/(2b) gives the largest heat s [v]. If the stress limit, at the temperature after that largest heat, is
// below c/(2b), two slipping solutions exist in addition to sticking, one with more and one with less slip.
std::optional<SeveralAnswers> several_answers(const Physics& physics) {
  const ModelOptions& o = physics.options;
  const Host& host = physics.host;
  // With junctions, with a friction coefficient that varies or with a flowing layer a step may have several solutions
  // for other reasons, which this search does not cover. Under a tolerance the substeps are so short that each has one
  // solution.
  if (o.strategy != Strategy::kForceDriven || o.junctions || o.plastic_layer || o.tolerance ||
      o.interface.friction_law != FrictionLaw{}) {
    return std::nullopt;
  }
  const Material soft = at_pressure(o.soft, host.pressure);
  const double T_melt = soft.melting_temperature;
  const HeatKernel kernel(o.soft, o.grid);
  const double mobility =
      0.5 * (1.0 / (o.soft.density * host.half_zone_soft) + 1.0 / (o.hard.density * host.half_zone_hard));
  for (double dt = std::max(host.dt, shortest_step(o)); dt <= kLongestStep; dt *= 2.0) {
    const double b = mobility * dt;
    const double heating = heat_partition(o.soft, o.hard) * kernel.integral(dt);
    std::optional<SeveralAnswers> best;
    double least = kClearly;
    for (double below = 1e-3; below < 0.5 * T_melt; below *= 1.1) {
      const double stress = kStickShare * limit_at(o, host.pressure, soft, T_melt - below);
      const double hottest = T_melt - below + heating * b * stress * stress / 4.0;
      const double left = limit_at(o, host.pressure, soft, std::min(hottest, T_melt)) / (0.5 * stress);
      if (!(left < least)) continue;
      least = left;
      best = {.dt = dt, .temperature = T_melt - below, .below = below, .slip = b * stress};
    }
    if (best) return best;
  }
  return std::nullopt;
}

}  // namespace shearbus::study::stability
