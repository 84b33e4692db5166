// The temperatures of one lane's layer as its heating makes them, and the strength of its weakest vertex.
#pragma once

#include <cstddef>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// T = T_ad + q B over the vertices that may be the layer's hottest: z = 0 alone where that is where all heat has ever
// entered and none ever leaves.
struct Heated {
  const double* T_ad = nullptr;  // [vertex][lane], at the lane
  const double* B = nullptr;     // [vertex], or [vertex][lane] at the lane
  std::ptrdiff_t stride = 1;     // of B
  int candidates = 1;

  double response(int i) const { return B[i * stride]; }
  double T(int i, double q) const { return T_ad[std::ptrdiff_t{i} * kLanes] + q * response(i); }
  int hottest(double q) const {
    int at = 0;
    for (int i = 1; i < candidates; ++i) at = T(i, q) > T(at, q) ? i : at;
    return at;
  }
};

// The stress at which the first vertex reaches its ceiling, limit.tresca g(T), where a stress a heats by the flux
// q = rise a max(0, c - b a), which must rise with a; `a_max` where none does. `hottest`: the vertex
// that is hottest without that heat; then the one that holds the stress.
double ceiling_stress(const StressLimit& limit, const Heated& heated, const FrictionHeating& flux, double a_max,
                      double guess, int& hottest);

}  // namespace shearbus::physics
