// The interface of a velocity-driven layer under a contact law (MODEL.md, "Velocity-driven step"): how much of the jump
// slips there. balance.cpp includes this file.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "server/physics/interface/edge_zero.hpp"
#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/flow/heated.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"

namespace shearbus::physics {

// What sets the upper end of the bracket in which the stress of a step is sought. That stress may equal the bound,
// unless the bound is of the kind kNotAnAnswer.
enum class Bound { kElastic, kContact, kCeiling, kNotAnAnswer };

// The balance of one lane in magnitudes along the trial direction:
//   F(a) = a + compliance * integral(dep)(a) - a_trial = 0,   q = heating a
struct Lane {
  double direction = 1.0;         // direction of the trial stress, 1 or -1
  double a_trial = 0.0;           // magnitude of the elastic trial stress, |s_old + G0 dt w / h|  [Pa]
  double heating = 0.0;           // heat flux per stress: beta_T max([V] direction, 0)           [m/s]
  double lo = 0.0, hi = 0.0;      // bracket of the root, F(lo) < 0                                  [Pa]
  double a = 0.0;                 // stress magnitude: the iterate, at the end the answer           [Pa]
  Bound bound = Bound::kElastic;  // kind of the bound `hi`; has no meaning once hi_seen is true
  int sums = 0;                   // number of sums of the flow over the layer that the search has needed
  int hottest = 0;                // vertex whose ceiling Y_max g(T) a rising stress reaches first
  bool loaded = false;            // the trial stress is not 0
  bool hi_seen = false;           // the balance F at `hi` has been evaluated and is not negative
  bool done = false;
  bool at_bound = false;  // the answer is the bound `hi`, of the kind `bound`
};

// The interface of one lane whose limit depends on its slip or has a state.
struct Sliding {
  StressLimit limit;
  ContactState state;
  double T_ad = 0.0, T_per_stress = 0.0;  // T0 = T_ad + T_per_stress a  [K], [K/Pa]
  bool stuck = false;                     // the interface did not slip at the end of the last step
  EdgeZero search;
  double a_stick = 0.0;       // stress under which the interface sticks  [Pa]
  double ceiling_slip = 0.0;  // slip velocity of the interface next to a layer that flows at its ceiling  [m/s]
  bool searches = false;
  bool several = false;  // the interface could stick as well

  SlipPoint point(double a, double slip) const { return {a, T_ad + T_per_stress * a, slip}; }
};
using Contacts = std::array<Sliding, kLanes>;

// The largest stress of an interface whose slip is known or does not matter: the root of the limit at the temperature
// that the stress causes. With INTERFACE_SLIP the jump is the slip. Infinity where slide() has to find the slip.
inline double limit_without_slip(const Problem& problem, const Material& soft, double pressure, double jump,
                                 const Heated& heated, const Lane& lane, const Sliding* contact, double guess) {
  const bool known = problem.options.drive == Drive::kInterfaceSlip;
  if (contact != nullptr && !known) return std::numeric_limits<double>::infinity();
  const StressLimit limit = contact != nullptr ? contact->limit.at_slip(std::abs(jump))
                                               : interface_strength(problem.interface, soft, pressure, nullptr);
  if (limit.varying == nullptr && !limit.vanishes_at_melting()) return limit.coulomb;
  return slip_stress(limit, {heated.T(0, 0.0), heated.response(0), lane.heating, 0.0}, lane.hi, guess);
}

// The slip of the interfaces whose limit depends on it, after the balance without slip has been solved: a sticking
// interface sticks while it can, a slipping one takes the answer with the most slip. The stress falls from that of
// the sticking interface, and with it the flow; the interface slips by what elastic shear and flow leave of the jump.
// `flow`: the flow of the layer; null if it does not harden, and flows at its ceiling only.
inline void slide(LayerFlow* flow, double compliance, double dt, Lane (&lanes)[kLanes], Contacts& sliding,
                  double* strain_new) {
  const auto slip_under = [&](int l, double a) {
    return std::max(0.0, kSqrt3 / dt * ((lanes[l].a_trial - a) / compliance - (flow != nullptr ? flow->slip[l] : 0.0)));
  };
  const auto sum_flow = [&] {
    if (flow == nullptr) return;
    for (int l = 0; l < kLanes; ++l) flow->load(l, lanes[l].a, lanes[l].heating);
    flow->sum(kAllLanes, strain_new);
  };
  bool searching = false, summed = true;
  for (int l = 0; l < kLanes; ++l) {
    Lane& lane = lanes[l];
    Sliding& own = sliding[l];
    if (!lane.loaded || !lane.done) continue;
    const SlipPoint stick = own.point(lane.a, 0.0);
    const bool can_stick = own.limit.at(stick.T, 0.0).stress >= lane.a;
    if (can_stick && own.stuck) continue;
    own.several = can_stick;
    own.a_stick = lane.a;
    own.search = EdgeZero(own.limit, own.point(0.0, kSqrt3 / dt * lane.a_trial / compliance), stick, stick);
    own.searches = true;
    searching = searching || !own.search.done();
  }
  while (searching) {
    for (int l = 0; l < kLanes; ++l) {
      if (sliding[l].searches && !sliding[l].search.done()) lanes[l].a = sliding[l].search.at();
    }
    sum_flow();
    searching = false;
    for (int l = 0; l < kLanes; ++l) {
      Sliding& own = sliding[l];
      if (!own.searches || own.search.done()) continue;
      ++lanes[l].sums;
      own.search.update(own.point(lanes[l].a, slip_under(l, lanes[l].a)));
      searching = searching || !own.search.done();
    }
  }
  for (int l = 0; l < kLanes; ++l) {
    if (!sliding[l].searches) continue;
    Lane& lane = lanes[l];
    Sliding& own = sliding[l];
    const SlipPoint& answer = own.search.answer();
    const bool failed = std::isnan(answer.a);
    const double rest = kAtRest * kSqrt3 / dt * lane.a_trial / compliance;
    const bool slides = own.search.found() && !failed && answer.v > rest;
    if (!slides && lane.at_bound && lane.bound == Bound::kCeiling)
      own.ceiling_slip = slip_under_ceiling(own.limit, own.search, own.point(own.a_stick, 0.0), rest);
    own.several = own.several && slides;
    const double a = slides ? answer.a : own.a_stick;
    summed = summed && lane.a == a;
    lane.a = a;
    lane.done = !failed;
    if (!slides) continue;
    lane.at_bound = true;
    lane.bound = Bound::kContact;
  }
  if (summed) return;
  sum_flow();
}

}  // namespace shearbus::physics
