// Heat conduction in both bodies by one operator across z = 0. The heat is then divided by conduction and not by the
// partition coefficient, DLP (18-19).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kDt = 1e-9;  // step length [s]

ModelOptions paper(Strategy strategy = Strategy::kVelocityDriven, FarBoundary far = FarBoundary::kHalfSpace) {
  ModelOptions options = graded(paper_options(strategy));
  options.grid.far_boundary = far;
  return options;
}

// Steps two rigs side by side at the paper's pressure, from the same jump [m/s], and calls `look` after every step.
template <typename Look>
void run_beside(Rig& one, Rig& two, int steps, double dt, double jump, const Look& look) {
  double jump_one = jump, jump_two = jump;
  // far stresses that keep the bodies of both rigs sliding in force-driven steps
  for (Rig* rig : {&one, &two}) rig->inputs.stress_soft[0] = rig->inputs.stress_hard[0] = 170e6;
  for (int n = 1; n <= steps; ++n) {
    one.set_all(jump_one, 11.2e9);
    two.set_all(jump_two, 11.2e9);
    one.step(dt);
    two.step(dt);
    if (one.model.options().strategy == Strategy::kForceDriven) {
      jump_one = one.outputs.velocity_jump_new[0];
      jump_two = two.outputs.velocity_jump_new[0];
    }
    look(n);
  }
}

// Vernotte's solution: of the heat at the contact of two half-spaces, the soft one takes the share beta_T (partition
// coefficient) at all times. On grids scaled with the diffusion lengths of the bodies, the discrete scheme gives
// exactly this share, so conduction in both bodies and a prescribed beta_T must give the same answer.
TEST(PhysicsTwoSided, OnScaledGridsThePartitionAnswerComesBackToRounding) {
  for (Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    Rig one(paper(strategy), 1), two(two_sided(paper(strategy)), 1);
    double worst = 0.0;
    run_beside(one, two, 1000, kDt, 100.0, [&](int n) {
      if (n > 10) {
        ASSERT_NE(two.outputs.regime[0], Regime::kStick) << n;
      }
      ASSERT_NEAR(two.outputs.interface_temperature[0] / one.outputs.interface_temperature[0], 1.0, 1e-11) << n;
      ASSERT_NEAR(two.outputs.shear_stress[0] / one.outputs.shear_stress[0], 1.0, 1e-8) << n;
      worst = std::max(worst, std::abs(two.outputs.shear_stress[0] / one.outputs.shear_stress[0] - 1.0));
      // On grids scaled with the diffusion lengths both bodies have the same temperature at the same number of cells
      // from z = 0.
      for (int i = 1; i < 60; ++i) ASSERT_NEAR(two.T(-i) / two.T(i), 1.0, 1e-11) << n << ", vertex " << i;
    });
    std::printf("partition against two-sided on scaled grids, worst s apart: %.1e\n", worst);
    EXPECT_NEAR(two.stored_heat(300.0) * one.conducted_share() / one.stored_heat(300.0), 1.0, 1e-9);
  }
}

// Any grid may be chosen for the hard body. On a grid that is not scaled with the diffusion length of the body the
// share of the heat is the partition coefficient beta_T to the accuracy of the grids.
TEST(PhysicsTwoSided, OnOtherGridsThePartitionAnswerComesBackToTheirAccuracy) {
  for (Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    for (const GridOptions& hard :
         {GridOptions{20e-6, 60, 1.08, FarBoundary::kHalfSpace}, GridOptions{5e-6, 200, 1.0, FarBoundary::kHalfSpace},
          GridOptions{20e-6, 80, 1.08, FarBoundary::kInsulated}}) {
      Rig one(paper(strategy), 1), two(two_sided(paper(strategy), hard), 1);
      double worst = 0.0;
      run_beside(one, two, 1000, kDt, 100.0, [&](int n) {
        if (n < 10) return;
        const double rise = one.outputs.interface_temperature[0] - 300.0;
        worst = std::max(worst, std::abs(two.outputs.interface_temperature[0] - 300.0 - rise) / rise);
      });
      EXPECT_LT(worst, 2e-3) << hard.cells;
      EXPECT_GT(worst, 1e-12) << hard.cells;  // the two models do differ on these grids, by more than rounding
    }
  }
}

// beta_T is the share of the heat that a soft half-space takes. An insulated soft layer of 20 um fills with heat within
// microseconds; from then on it takes less than this share, and the hard half-space takes more.
TEST(PhysicsTwoSided, PartsFromThePartitionOnceTheLayerHasFilled) {
  ModelOptions filling = paper(Strategy::kVelocityDriven, FarBoundary::kInsulated);
  filling.drive = Drive::kInterfaceSlip;
  ModelOptions drinking = two_sided(filling);
  drinking.hard_grid->far_boundary = FarBoundary::kHalfSpace;
  Rig one(filling, 1), two(drinking, 1);
  double apart_1us = 0.0, apart_12us = 0.0;
  run_beside(one, two, 3000, 4e-9, 10.0, [&](int n) {
    const double rise = one.outputs.interface_temperature[0] - 300.0;
    const double apart = (two.outputs.interface_temperature[0] - 300.0) / rise - 1.0;
    if (n == 250) apart_1us = apart;
    if (n == 3000) apart_12us = apart;
  });
  std::printf("two-sided T0 rise against partition's, insulated layer of 20 um: %+.1e at 1 us, %+.3f at 12 us\n",
              apart_1us, apart_12us);
  EXPECT_LT(std::abs(apart_1us), 2e-3);
  EXPECT_LT(apart_12us, -0.05);
}

// After the contact has opened, the hard half-space draws the heat back out of the insulated layer. The interface is
// then the coldest place of the layer, and no temperature leaves the range between the initial and the highest
// temperature.
TEST(PhysicsTwoSided, TheHardBodyDrawsHeatBackThroughTheInterface) {
  ModelOptions options = two_sided(paper(Strategy::kVelocityDriven, FarBoundary::kInsulated));
  options.hard_grid->far_boundary = FarBoundary::kHalfSpace;
  Rig rig(options, 1);
  rig.set_all(100.0, 11.2e9);
  for (int n = 0; n < 1000; ++n) rig.step(kDt);
  const double heat = rig.stored_heat(300.0);
  const double hottest = rig.T(0);
  rig.set_all(100.0, -1e9);
  for (int n = 0; n < 1000; ++n) rig.step(2e-8);
  EXPECT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-11);
  EXPECT_LT(rig.T(0), rig.T(60));
  const int first = -static_cast<int>(rig.model.layout().num_hard_vertices);
  for (int i = first; i <= 60; ++i) {
    EXPECT_GE(rig.T(i), 300.0 * (1 - 1e-15)) << i;
    EXPECT_LE(rig.T(i), hottest) << i;
  }
}

TEST(PhysicsTwoSided, WarningsNameTheHardFace) {
  ModelOptions options = two_sided(paper());
  EXPECT_TRUE(Model(options).warnings().empty());
  options.hard_grid->far_boundary = FarBoundary::kInsulated;
  ASSERT_EQ(Model(options).warnings().size(), 1u);
  EXPECT_NE(Model(options).warnings()[0].find("hard_layer.far_boundary"), std::string::npos);
}

}  // namespace
}  // namespace shearbus::testing
