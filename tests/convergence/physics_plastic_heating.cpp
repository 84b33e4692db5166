// Plastic-work heating in the paper's case, on refined grids and with refined steps. The results converge until the
// flow localises in a band; afterwards the test can only report their spread.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

struct Found {
  double T0, T_hottest, s;
};

// Runs the paper's case in all lanes. The velocity jump of each lane is a few ulps larger than that of the previous
// lane.
std::vector<Found> run_lanes(int cells, double grading, double dt, double t) {
  ModelOptions options = two_sided(graded(paper_options(), cells, grading));
  options.taylor_quinney_factor = 1.0;
  Rig rig(options);
  rig.set_all(100.0, 11.2e9);
  for (int l = 0; l < kLanes; ++l) rig.inputs.velocity_jump[l] *= 1.0 + l * 2e-15;
  double heat = 0.0;
  for (int n = static_cast<int>(std::lround(t / dt)); n > 0; --n) {
    rig.step(dt);
    heat += rig.outputs.friction_heat[0];
  }
  EXPECT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-10);
  std::vector<Found> found;
  for (int l = 0; l < kLanes; ++l) {
    double T_hottest = 0.0;
    for (int i = 0; i <= cells; ++i) T_hottest = std::max(T_hottest, rig.T(i, l));
    found.push_back({rig.T(0, l), T_hottest, rig.stress(l)});
  }
  return found;
}

Found run(int cells, double grading, double dt, double t) {
  return run_lanes(cells, grading, dt, t).front();
}

TEST(PhysicsPlasticHeatingConvergence, FirstOrderInTimeBeforeTheLayerLocalises) {
  // first order: the instant of yield within a step is not resolved
  Orders orders("plastic-work heating, 120 cells graded 1.04, 200 ns, dt: change of T0", 1.0, 0.2);
  double before = 0.0;
  for (double dt : {2e-9, 1e-9, 0.5e-9, 0.25e-9, 0.125e-9}) {
    const Found found = run(120, 1.04, dt, 200e-9);
    if (before != 0.0) orders.add(dt, found.T0 - before);
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

// A rate-independent layer that is softened by its own heat forms a shear band, and nothing in the model determines the
// place of the band: it depends on the grid, the step and, on the finest grid, the last bit of an input. In every case
// no vertex melts, T0 stays far below melting, and the stress stays below the peak stress of a layer that is heated at
// z = 0 only.
TEST(PhysicsPlasticHeatingConvergence, TheBandsStressIsReportedWithItsSpread) {
  std::printf("plastic-work heating after 1 us: cells, grading, dt, T0, hottest, s of eight lanes a few bits apart\n");
  for (auto [cells, grading] : {std::pair{60, 1.08}, std::pair{120, 1.04}, std::pair{250, 1.0}}) {
    for (double dt : {1e-9, 0.5e-9, 0.25e-9}) {
      std::vector<Found> lanes = run_lanes(cells, grading, dt, 1e-6);
      std::ranges::sort(lanes, {}, &Found::s);
      std::printf("  %4d  %4.2f  %7.2g s  %6.1f K  %7.1f K  %6.1f to %6.1f MPa\n", cells, grading, dt, lanes[4].T0,
                  lanes[4].T_hottest, lanes.front().s / 1e6, lanes.back().s / 1e6);
      for (const Found& found : lanes) {
        EXPECT_NEAR(found.T0, 460.0, 35.0);
        EXPECT_LT(found.T_hottest, 1220.0);
        EXPECT_LT(found.s, 293e6);
      }
      EXPECT_GT(lanes[4].T_hottest, 0.99 * 1220.0);
      EXPECT_LT(lanes[4].s, 200e6);
    }
  }
}

// A layer of Preston, Tonks and Wallace's copper under a jump of 300 m/s at the time `t`. The velocity jump of each lane
// is a few ulps larger than that of the previous lane.
struct RateHardened {
  double s[kLanes], T0[kLanes], T_hottest;
  double width;  // of the flow in the last step, (integral of dep)^2 / integral of dep^2  [m]
};
RateHardened run_rate_hardened(int cells, double t) {
  constexpr double kStep = 1e-9;
  ModelOptions options = paper_options();
  options.soft = make_material("copper_ofhc_ptw", {}).material;
  options.grid.cells = cells;
  options = two_sided(options);
  options.taylor_quinney_factor = 1.0;
  Rig rig(options);
  rig.set_all(300.0, 11.2e9);
  for (int l = 0; l < kLanes; ++l) rig.inputs.velocity_jump[l] *= 1.0 + l * 2e-15;
  for (int n = static_cast<int>(std::lround(t / kStep)); n > 0; --n) rig.step(kStep);
  RateHardened found{};
  for (int l = 0; l < kLanes; ++l) {
    found.s[l] = rig.stress(l);
    found.T0[l] = rig.T(0, l);
  }
  double flow = 0.0, squares = 0.0;
  for (int i = 0; i <= cells; ++i) {
    const double dep = rig.ep(i) - rig.ep_of(rig.trial, i, 0), weight = rig.model.grid().weight[i];
    found.T_hottest = std::max(found.T_hottest, rig.T(i));
    flow += weight * dep;
    squares += weight * dep * dep;
  }
  found.width = flow * flow / squares;
  return found;
}

// With a strength that rises with the rate the flow cannot gather where a last bit decides: grids and lanes agree, before
// the layer melts at its insulated face and after. The width of the flow is that of the layer until a vertex melts. From
// then on the flow of a step gathers in this vertex, since near melting the rate hardens less than the heat softens.
TEST(PhysicsPlasticHeatingConvergence, ARateThatHardensMakesGridsAndLastBitsAgree) {
  std::printf("plastic-work heating, a law with rates, 300 m/s: time, cells, T0, hottest, s, width of the flow\n");
  for (const double t : {360e-9, 450e-9}) {
    std::vector<RateHardened> found;
    for (const int cells : {125, 250, 500}) {
      found.push_back(run_rate_hardened(cells, t));
      const RateHardened& at = found.back();
      std::printf("  %3.0f ns  %4d  %9.4f K  %7.1f K  %10.5f MPa  %6.2f um\n", t * 1e9, cells, at.T0[0], at.T_hottest,
                  at.s[0] / 1e6, at.width * 1e6);
      for (int l = 1; l < kLanes; ++l) {
        EXPECT_NEAR(at.s[l] / at.s[0], 1.0, 1e-9) << l;
        EXPECT_NEAR(at.T0[l], at.T0[0], 1e-8) << l;
      }
    }
    const bool molten = t > 400e-9;
    EXPECT_NEAR((found[1].T0[0] - found[0].T0[0]) / (found[2].T0[0] - found[1].T0[0]), 4.0, 0.5);  // second order
    EXPECT_NEAR(found[1].s[0] / found[2].s[0], 1.0, molten ? 1e-3 : 1e-6);
    EXPECT_NEAR(found[0].s[0] / found[2].s[0], 1.0, molten ? 1e-3 : 1e-5);
    EXPECT_NEAR(found[0].width / found[2].width, molten ? 4.0 : 1.0, 1e-3);
    EXPECT_EQ(found[2].T_hottest > 0.99 * 1356.0, molten);
  }
}

}  // namespace
}  // namespace shearbus::testing
