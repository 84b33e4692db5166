// Plastic-work heating in the paper's case as grid and step are refined: converged until the layer localises, and a
// spread to be reported from there on.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

struct Found {
  double T0, T_hottest, s;
};

Found run(int cells, double grading, double dt, double t) {
  ModelOptions options = two_sided(graded(paper_options(), cells, grading));
  options.taylor_quinney_factor = 1.0;
  Rig rig(options, 1);
  rig.set_all(100.0, 11.2e9);
  double heat = 0.0;
  for (int n = static_cast<int>(std::lround(t / dt)); n > 0; --n) {
    rig.step(dt);
    heat += rig.outputs.friction_heat[0];
  }
  EXPECT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-10);
  double T_hottest = 0.0;
  for (int i = 0; i <= cells; ++i) T_hottest = std::max(T_hottest, rig.T(i));
  return {rig.T(0), T_hottest, rig.stress()};
}

TEST(PhysicsPlasticHeatingConvergence, FirstOrderInTimeBeforeTheLayerLocalises) {
  std::printf("plastic-work heating, 120 cells graded 1.04, 200 ns: dt, T0, s, order in T0\n");
  double before = 0.0, difference_before = 0.0;
  for (double dt : {2e-9, 1e-9, 0.5e-9, 0.25e-9, 0.125e-9}) {
    const Found found = run(120, 1.04, dt, 200e-9);
    const double difference = found.T0 - before;
    const double order = difference_before != 0.0 ? std::log2(difference_before / difference) : NAN;
    std::printf("  %8.3g s  %9.4f K  %9.4f MPa  %6.3f\n", dt, found.T0, found.s / 1e6, order);
    if (difference_before != 0.0) {
      EXPECT_NEAR(order, 1.0, 0.2);  // where in a step the layer first yields is felt to the end
    }
    difference_before = before != 0.0 ? difference : 0.0;
    before = found.T0;
  }
}

TEST(PhysicsPlasticHeatingConvergence, GridsAgreeBeforeTheLayerLocalises) {
  const Found fine = run(500, 1.0, 1e-9, 300e-9);
  for (auto [cells, grading] : {std::pair{250, 1.0}, std::pair{120, 1.04}, std::pair{60, 1.08}}) {
    const Found found = run(cells, grading, 1e-9, 300e-9);
    EXPECT_NEAR(found.s / fine.s, 1.0, 2e-5) << cells;
    EXPECT_NEAR(found.T0, fine.T0, 0.1) << cells;
  }
}

// A rate-independent layer that softens by its own heat forms a band, and nothing in the model says where: grid and
// step do. What holds whatever they are: no vertex melts, the interface stays far below, the stress below the
// surface-heated layer's peak.
TEST(PhysicsPlasticHeatingConvergence, TheBandsStressIsReportedWithItsSpread) {
  std::printf("plastic-work heating after 1 us: cells, grading, dt, T0, hottest, s\n");
  double lowest = 1e300, highest = 0.0;
  for (auto [cells, grading] : {std::pair{60, 1.08}, std::pair{120, 1.04}, std::pair{250, 1.0}}) {
    for (double dt : {1e-9, 0.5e-9, 0.25e-9}) {
      const Found found = run(cells, grading, dt, 1e-6);
      std::printf("  %4d  %4.2f  %7.2g s  %6.1f K  %7.1f K  %6.1f MPa\n", cells, grading, dt, found.T0, found.T_hottest,
                  found.s / 1e6);
      EXPECT_NEAR(found.T0, 450.0, 25.0);
      EXPECT_GT(found.T_hottest, 0.99 * 1220.0);
      EXPECT_LT(found.T_hottest, 1220.0);
      EXPECT_LT(found.s, 200e6);
      lowest = std::min(lowest, found.s);
      highest = std::max(highest, found.s);
    }
  }
  std::printf("  s from %.1f to %.1f MPa\n", lowest / 1e6, highest / 1e6);
}

}  // namespace
}  // namespace shearbus::testing
