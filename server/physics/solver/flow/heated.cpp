#include "server/physics/solver/flow/heated.hpp"

namespace shearbus::physics {

// Lowers the stress from a_max to the ceiling of the vertex that is the hottest under the stress. A lower stress heats
// less, so that another vertex may become the hottest: repeats this until the hottest vertex does not change.
double ceiling_stress(const StressLimit& limit, const Heated& heated, const FrictionHeating& flux, double a_max,
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
