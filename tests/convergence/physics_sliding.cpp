// Complete steps of the layer against the values of tests/measured.toml, "Exact solutions".
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

struct History {
  std::vector<double> T0, s;  // interface temperature [K] and stress [Pa] at the end of each step
  double at(const std::vector<double>& column, double t, double dt) const {
    return column[static_cast<std::size_t>(std::lround(t / dt)) - 1];
  }
};

History imposed_jump(const ModelOptions& options, double v, double dt, double t_end) {
  Rig rig(options, 1);
  rig.set_all(v, 11.2e9);
  History history;
  for (int n = 0; n < std::lround(t_end / dt); ++n) {
    rig.step(dt);
    history.T0.push_back(rig.outputs.interface_temperature[0]);
    history.s.push_back(rig.outputs.shear_stress[0]);
  }
  return history;
}

void expect_paper_values(const ModelOptions& options) {
  const History history = imposed_jump(options, 100.0, 1e-9, 2e-6);
  double peak = 0.0;
  std::size_t when = 0;
  for (std::size_t n = 0; n < history.s.size(); ++n) {
    if (history.s[n] > peak) {
      peak = history.s[n];
      when = n;
    }
  }
  EXPECT_NEAR(peak / 293.3e6, 1.0, 5e-3);
  EXPECT_NEAR(static_cast<double>(when) * 1e-9, 0.3e-6, 0.05e-6);
  for (const auto& [t, s] : {std::pair{0.6e-6, 208.7e6}, {1e-6, 142.6e6}, {2e-6, 92.8e6}}) {
    EXPECT_NEAR(history.at(history.s, t, 1e-9) / s, 1.0, 5e-3) << t;
  }
  for (const auto& [t, T0] : {std::pair{0.1e-6, 685.0}, {0.3e-6, 1014.0}}) {
    EXPECT_NEAR(history.at(history.T0, t, 1e-9), T0, 2.0) << t;
  }
  for (double t : {0.6e-6, 1e-6, 2e-6}) {
    EXPECT_LT(history.at(history.T0, t, 1e-9), 1220.0);
    EXPECT_GT(history.at(history.T0, t, 1e-9), 1218.0);
  }
}

TEST(PhysicsPaperCase, FiveHundredUniformCells) {
  expect_paper_values(paper_options());
}
TEST(PhysicsPaperCase, SixtyGradedCells) {
  expect_paper_values(graded(paper_options()));
}

// All the work of the imposed jump becomes heat, DLP (18). Stress and T0 must then hardly depend on the length of the
// steps.
TEST(PhysicsPaperCase, OneAndAQuarterNanosecondAgreeEverywhere) {
  const History coarse = imposed_jump(graded(paper_options()), 100.0, 1e-9, 2e-6);
  const History fine = imposed_jump(graded(paper_options()), 100.0, 0.25e-9, 2e-6);
  double worst_s = 0.0, worst_T0 = 0.0;
  for (double t = 20e-9; t <= 2e-6; t += 1e-9) {
    worst_s = std::max(worst_s, std::abs(coarse.at(coarse.s, t, 1e-9) / fine.at(fine.s, t, 0.25e-9) - 1.0));
    worst_T0 = std::max(worst_T0, std::abs(coarse.at(coarse.T0, t, 1e-9) / fine.at(fine.T0, t, 0.25e-9) - 1.0));
  }
  std::printf("paper case, dt 1 ns against 0.25 ns, 20 ns to 2 us: largest difference of s %.2e, of T0 %.2e\n", worst_s,
              worst_T0);
  EXPECT_LT(worst_s, 3e-3);
  EXPECT_LT(worst_T0, 3e-3);
}

TEST(PhysicsInterfaceSlip, ConvergesInTimeToFirstOrder) {
  ModelOptions options = graded(paper_options(), 120, 1.04);
  options.drive = Drive::kInterfaceSlip;
  Orders orders("interface slip, 100 m/s, at 100 ns, dt: change of T0", 1.0, 0.1);
  double T_before = 0.0;
  for (double dt : {4e-9, 2e-9, 1e-9, 0.5e-9, 0.25e-9}) {
    const History h = imposed_jump(options, 100.0, dt, 100e-9);
    if (T_before != 0.0) orders.add(dt, h.T0.back() - T_before);
    T_before = h.T0.back();
  }
}

// The plastic strain at z = 0 grows as the cells shrink. Stress and total slip hardly depend on the grid.
TEST(PhysicsPaperCase, InterfaceStrainIsAGridScaleValue) {
  std::printf("paper case at 1 us, uniform cells: cells, s, T0, slip, ep(0)\n");
  std::vector<double> ep, s, slip;
  for (int cells : {250, 500, 1000}) {
    ModelOptions options = paper_options();
    options.grid.cells = cells;
    Rig rig(options, 1);
    rig.set_all(100.0, 11.2e9);
    for (int n = 0; n < 1000; ++n) rig.step(1e-9);
    ep.push_back(rig.ep(0));
    s.push_back(rig.stress());
    slip.push_back(rig.plastic_slip());
    std::printf("  %5d  %.3f MPa  %.3f K  %.4f um  %.2f\n", cells, s.back() / 1e6, rig.T(0), slip.back() * 1e6,
                ep.back());
  }
  EXPECT_NEAR(ep[1] / ep[0], 2.0, 0.3);
  EXPECT_NEAR(ep[2] / ep[1], 2.0, 0.3);
  EXPECT_NEAR(s[2] / s[1], 1.0, 3e-3);
  EXPECT_NEAR(slip[2] / slip[1], 1.0, 1e-5);
}

// Under a constant jump v the interface stays just below melting, and the stress approaches s = k (T_melt - T_ref) /
// (beta_T v sqrt(pi alpha t)), where T_ref is the initial temperature.
TEST(PhysicsPinnedMelting, StressApproachesTheAsymptote) {
  ModelOptions options = graded(paper_options());
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  const double v = 1000.0, dt = 1e-9;
  const History history = imposed_jump(options, v, dt, 16e-6);
  const double beta_T = heat_partition(options.soft, options.hard);
  std::printf("pinned melting at 1000 m/s: t, s, s / asymptote\n");
  double before = 1e300;
  for (double t : {0.25e-6, 1e-6, 4e-6, 16e-6}) {
    const double asymptote =
        options.soft.conductivity * 920.0 / (beta_T * v * std::sqrt(M_PI * options.soft.diffusivity * t));
    const double ratio = history.at(history.s, t, dt) / asymptote;
    std::printf("  %7.2g s  %.4f MPa  %.5f\n", t, history.at(history.s, t, dt) / 1e6, ratio);
    EXPECT_LT(std::abs(ratio - 1.0), before) << t;
    before = std::abs(ratio - 1.0);
  }
  EXPECT_LT(before, 1e-3);
}

}  // namespace
}  // namespace shearbus::testing
