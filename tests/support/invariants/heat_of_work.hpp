// An invariant of server/physics/MODEL.md, "What always holds": all heat comes from friction work.
#pragma once

#include <algorithm>
#include <cmath>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"

namespace shearbus::testing {

// Returns true for a step of second order. Both its stages contribute to the heat. The answer holds the stress of the
// second stage if the step is velocity-driven, the mean stress of the stages if it is force-driven.
inline bool of_two_stages(const ModelOptions& options, const Answered& a) {
  return options.time_integrator == TimeIntegrator::kSdirk2 && !(a.outcome & kFirstOrder);
}

// Requires that the heat of a step is the fraction `share` of the work: of the work of the slip in a force-driven step,
// of the work of the imposed velocity jump in a velocity-driven step. Plastic-work heating with the Taylor-Quinney
// factor X gives between X times this heat and all of it.
inline void require_heat_of_work(const ModelOptions& options, double share, const Answered& a) {
  if (options.strategy == Strategy::kVelocityDriven) {
    if (a.in_parts() || of_two_stages(options, a)) return;
    const double work = std::max(0.0, a.stress * a.jump_old) * a.dt;
    const double least = options.taylor_quinney_factor.value_or(1.0) * share * work;
    // A layer with inertia answers a stress next to 0 as 0 where it opposes the slip.
    const double unanswered = options.inertia && a.stress == 0.0 ? kNoStress : 1e-15 * std::abs(a.stress);
    const double noise = unanswered * a.jump_length * a.dt + kProductOfDenormals;
    require(a.heat >= least * (1 - 1e-13) - noise && a.heat <= share * work * (1 + 1e-13) + noise,
            "heat {:.17g} of work {:.17g}, share {}", a.heat, work, share);
  } else if (!a.in_parts() && !(options.inertia && of_two_stages(options, a))) {
    const double work = a.stress * a.slip * a.dt;
    // Where plastic work heats, its share of what slip leaves of the mean jump.
    const double d = std::copysign(1.0, a.stress);
    const double left = d * (0.5 * (a.jump_old + a.jump_new) + a.plastic_drive - a.slip);
    const double plastic = options.taylor_quinney_factor.value_or(0.0) * (d * a.stress) * std::max(0.0, left) * a.dt;
    const double grain = plastic > 0.0 ? 1e-12 * (d * a.stress) * a.size() * a.dt : 0.0;
    require_near(a.heat, share * work + plastic, 1e-13 * (work + plastic) + grain + kProductOfDenormals,
                 "heat against friction work");
  }
}

}  // namespace shearbus::testing
