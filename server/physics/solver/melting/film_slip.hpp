// Stress and slip of a closed interface that may melt (MODEL.md, "Melt film"): solid contact and film are in series.
#pragma once

#include <algorithm>

#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/melting/melt_film.hpp"
#include "server/physics/solver/melting/phase_change.hpp"

namespace shearbus::physics {

// The interface of one step, in magnitudes along the trial direction. The film carries what shears it at the velocity
// of the end of the step, as an interface sticks at the end of a step: a film of no thickness then sticks.
struct FilmSlip {
  FilmSlip(const SolidContact& solid_contact, const TrialSlip& trial_slip, double heat_partition)
      : contact(solid_contact),
        trial(trial_slip),
        partition(heat_partition),
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
    double a = hottest;
    double left = spare(a);
    if (left < 0.0) return root_between(spare, 0.0, a, left);
    // Beyond `hottest` the carried stress does not fall with the stress, so repeated insertion rises to the first root.
    constexpr int kMostInsertions = 100;
    for (int i = 0; i < kMostInsertions && left > 1e-15 * a; ++i) {
      a = std::min(a + left, stick);
      left = spare(a);
    }
    if (left <= 1e-15 * a || a >= stick) return a;
    const double last = spare(stick);
    return last >= 0.0 ? stick : root_between(spare, a, stick, last);
  }

  // The root in [0, hottest], where `respond` is only an approximation; `hottest` if there is none.
  template <class Respond>
  double root_below_hottest(const Respond& respond) const {
    const auto spare = [&](double a) { return carried(respond(flux(a))) - a; };
    const double left = spare(hottest);
    return left >= 0.0 ? hottest : root_between(spare, 0.0, hottest, left);
  }

  SolidContact contact;
  TrialSlip trial;
  double partition;
  double mean_free;  // mean of the jumps before and after the step without friction  [m/s]
  double jump_free;  // jump after the step without friction                         [m/s]
  double stick;      // stress at which the jump after the step is 0  [Pa]
  double hottest;    // stress of most heat, at most `stick`          [Pa]

 private:
  template <class Spare>
  double root_between(const Spare& spare, double lo, double hi, double spare_hi) const {
    const double spare_lo = spare(lo);
    if (!(spare_lo > 0.0)) return lo;
    RootSearch search(lo, -spare_lo, hi, -spare_hi, hi, 0.5 * (lo + hi));
    while (!search.update(-spare(search.at()))) {
    }
    return search.at();
  }
};

}  // namespace shearbus::physics
