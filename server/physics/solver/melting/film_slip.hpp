// Stress and slip of a closed interface that may melt (MODEL.md, "Melt film"): solid contact and film are in series.
#pragma once

#include <algorithm>
#include <cmath>

#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/melting/melt_film.hpp"
#include "server/physics/solver/melting/phase_change.hpp"

namespace shearbus::physics {

// The interface of one step, in magnitudes along the trial direction. The film carries what shears it at the velocity
// of the end of the step, as an interface sticks at the end of a step: a film of no thickness then sticks.
struct FilmSlip {
  // `soft`: the material at the pressure.
  FilmSlip(const Problem& problem, const Material& soft, double pressure, const TrialSlip& trial_slip)
      : contact(problem.interface.friction_coefficient, problem.interface.yield_strength / kSqrt3, soft, pressure),
        trial(trial_slip),
        partition(problem.heat_partition),
        mean_free(0.5 * (trial_slip.jump_old + trial_slip.direction * trial_slip.jump_free)),
        jump_free(trial_slip.direction * trial_slip.jump_free),
        stick(trial_slip.stress_stick),
        hottest(mean_free > 0.0 ? std::min(stick, mean_free / trial_slip.per_stress) : stick) {}

  double film_stress(double compliance) const {
    return compliance > 0.0 ? jump_free / (trial.per_stress + compliance) : stick;
  }
  // The stress that contact and film carry.
  double carried(const PhaseChange::Response& at) const {
    return std::min({contact.stress(at.T0), film_stress(at.compliance), stick});
  }
  double slip(double a) const { return std::max(0.0, mean_free - 0.5 * trial.per_stress * a); }
  double flux(double a) const { return partition * (a * slip(a)); }

  // The root of a = carried(response to flux(a)) with the most slip. Up to the stress `hottest` the flux rises with the
  // stress, so that there is at most one root; beyond it there may be several, of which this is the smallest.
  // `respond(q)`: the response, which melts more and never cools where q is larger.
  template <class Respond>
  double root_most_slip(const Respond& respond) const {
    const auto spare = [&](double a) { return carried(respond(flux(a))) - a; };
    double a = root_below_hottest(respond);
    if (a < hottest || hottest >= stick) return a;
    // Beyond `hottest` the carried stress does not fall with the stress, so repeated insertion rises to the first root.
    constexpr int kMostInsertions = 100;
    double left = spare(a);
    for (int i = 0; i < kMostInsertions && left > kRounding * a; ++i) {
      a = std::min(a + left, stick);
      left = spare(a);
    }
    if (left <= kRounding * a || a >= stick) return a;
    const double last = spare(stick);
    return last >= 0.0 ? stick : RootBetween(a, left, stick, last).find(spare);
  }

  // The root in [0, hottest]; `hottest` if there is none. The carried stress falls with the stress there, so that the
  // root lies between the stress that is carried without heat and the one that is carried under the heat of that.
  template <class Respond>
  double root_below_hottest(const Respond& respond) const {
    const auto spare = [&](double a) { return carried(respond(flux(a))) - a; };
    double top = std::min(hottest, carried(respond(0.0)));
    const double least = top > 0.0 ? carried(respond(flux(top))) : 0.0;
    double above = least - top;
    if (above >= 0.0) return top;
    double bottom = std::max(least, kLeast * top);  // `top + above` would have lost the digits of a small stress
    double below = spare(bottom);
    while (below > 0.0 && top > 4.0 * bottom) {  // they may be many powers of ten apart
      const double middle = std::sqrt(bottom) * std::sqrt(top);
      const double at = spare(middle);
      (at > 0.0 ? bottom : top) = middle;
      (at > 0.0 ? below : above) = at;
    }
    return below > 0.0 ? RootBetween(bottom, below, top, above).find(spare) : bottom;
  }

  SolidContact contact;
  TrialSlip trial;
  double partition;
  double mean_free;  // mean of the jumps before and after the step without friction  [m/s]
  double jump_free;  // jump after the step without friction                         [m/s]
  double stick;      // stress at which the jump after the step is 0  [Pa]
  double hottest;    // stress of most heat, at most `stick`          [Pa]

 private:
  static constexpr double kRounding = 1e-15;  // relative rounding of a stress
  static constexpr double kLeast = 1e-200;    // least root that is looked for, relative to an upper bound

  // Finds the zero of a function that is positive at `lo` and negative at `hi`.
  struct RootBetween {
    RootBetween(double lo, double at_lo, double hi, double at_hi)
        : search(lo, -at_lo, hi, -at_hi, hi, 0.5 * (lo + hi)) {}
    template <class Spare>
    double find(const Spare& spare) {
      while (!search.update(-spare(search.at()))) {
      }
      return search.at();
    }
    RootSearch search;
  };
};

}  // namespace shearbus::physics
