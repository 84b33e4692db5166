// Temperatures of one lane's layer as functions of the heat flux, and the largest stress that the layer carries.
#pragma once

#include <cstddef>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// The temperatures T = T_ad + q B under the heat flux q, for the vertices that can be the hottest. If all heat enters
// at z = 0 and none leaves through z = 0, only the vertex at z = 0 can be the hottest.
struct Heated {
  const double* T_ad = nullptr;  // temperatures without the heat of the step: the lane's column of [vertex][lane]  [K]
  const double* B = nullptr;  // temperature rise per flux: [vertex], or the lane's column of [vertex][lane]  [K m2/W]
  std::ptrdiff_t stride = 1;  // distance in the array B from one vertex to the next: 1, or kLanes for [vertex][lane]
  int candidates = 1;         // number of vertices, from z = 0, that can be the hottest
  // Response B_phi to work that is released across the layer: the lane's column of [vertex][lane]; null: none is  [K m2/W]
  const double* B_work = nullptr;

  double response(int i) const { return B[i * stride]; }
  double work_response(int i) const { return B_work != nullptr ? B_work[std::ptrdiff_t{i} * kLanes] : 0.0; }
  double T(int i, double q) const { return T_ad[std::ptrdiff_t{i} * kLanes] + q * response(i); }
  double T(int i, double q, double work) const {
    return B_work != nullptr ? T(i, q) + work * work_response(i) : T(i, q);
  }
  int hottest(double q, double work = 0.0) const {
    int at = 0;
    for (int i = 1; i < candidates; ++i) at = T(i, q, work) > T(at, q, work) ? i : at;
    return at;
  }
};

// Returns the smallest stress at which a vertex reaches its ceiling limit.tresca g(T), or `a_max` if no vertex does. A
// stress a heats by the flux q = rise a max(0, c - b a), which must increase with a. `hottest`: on entry the vertex
// that is hottest without this heat, on return the vertex that limits the stress.
// Lowers the stress from a_max to the ceiling of the vertex that is the hottest under the stress. A lower stress heats
// less, so that another vertex may become the hottest: repeats this until the hottest vertex does not change.
inline double ceiling_stress(const StressLimit& limit, const Heated& heated, const FrictionHeating& flux, double a_max,
                             double guess, int& hottest) {
  double a = a_max;
  for (;;) {
    const int before = hottest;
    const double a_before = a;
    hottest = heated.hottest(flux.rise * (a * flux.slip(a)));
    if (a < a_max && hottest == before) return a;
    a = slip_stress(limit, {heated.T(hottest, 0.0), flux.rise * heated.response(hottest), flux.c, flux.b}, a, guess);
    if (!(a < a_before)) return a;  // ends the iteration also if `a` is not a number
  }
}

}  // namespace shearbus::physics
