#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/invariants.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

struct Point {
  int step;
  double T0, s;  // interface temperature [K], shear stress [Pa]
};

void expect_history(const ModelOptions& options, const std::vector<Point>& points) {
  Rig rig(options, 1);
  rig.set_all(100.0, 11.2e9);
  int n = 0;
  for (const Point& point : points) {
    for (; n < point.step; ++n) rig.step(1e-9);
    EXPECT_NEAR(rig.outputs.interface_temperature[0] / point.T0, 1.0, 1e-11) << n << " ns";
    EXPECT_NEAR(rig.outputs.shear_stress[0] / point.s, 1.0, 3e-9) << n << " ns";
  }
}

// Interface temperatures and stresses of tests/measured.toml, "Exact solutions": 500 uniform cells, dt = 1 ns,
// reproduced to rounding.
TEST(PhysicsVelocityDriven, PaperCaseToTenDigits) {
  expect_history(paper_options(), {{10, 398.146970801, 229.2063259e6},
                                   {100, 685.320394816, 280.5250815e6},
                                   {300, 1014.495922106, 293.2798836e6},
                                   {1000, 1218.945925353, 142.6492093e6}});
}

TEST(PhysicsVelocityDriven, InterfaceSlipToTenDigits) {
  ModelOptions options = paper_options();
  options.drive = Drive::kInterfaceSlip;
  EXPECT_NEAR(flow_stress(options.soft, 0.0, 11.2e9, 300.0) / kSqrt3, 199.7257674e6, 0.1);
  expect_history(options, {{10, 389.489696380, 197.9801299e6}, {100, 577.994984274, 190.1699374e6}});
}

TEST(PhysicsVelocityDriven, AnElasticStepIsTheTrialStress) {
  Rig rig(graded(paper_options()), 1);
  rig.set_all(10.0, 11.2e9);
  rig.step(1e-9);
  EXPECT_DOUBLE_EQ(rig.outputs.shear_stress[0], 27.6e9 * 1e-9 * 10.0 / 20e-6);
  EXPECT_EQ(rig.outputs.sliding_velocity[0], 0.0);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kStick);
  EXPECT_EQ(rig.outputs.outcome[0], kOutsideDomain);  // [v] = 0 differs from the imposed jump by more than 10 %
  EXPECT_GT(rig.outputs.friction_heat[0], 0.0);  // DLP (18): the imposed jump heats even while the layer is elastic
}

TEST(PhysicsVelocityDriven, WarningsNameWhatIsUnusual) {
  ModelOptions options = paper_options();
  EXPECT_EQ(Model(options).warnings().size(), 1u);  // one warning: the far face is insulated
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  EXPECT_TRUE(Model(options).warnings().empty());
  std::swap(options.soft, options.hard);
  ASSERT_EQ(Model(options).warnings().size(), 1u);
  EXPECT_NE(Model(options).warnings()[0].find("weaker body"), std::string::npos);
}

// After the layer has been loaded, the jump is held at 0. Heat flows inward and softens the layer, which flows and so
// loses stress. Its plastic slip must equal the elastic slip h ds / G0 that the loss ds releases, even if the stress at
// which a vertex begins to flow agrees with the stress after the step in all but the last digits.
TEST(PhysicsVelocityDriven, AHeldLayerFlowsAsItsStressRelaxes) {
  ModelOptions options = graded(paper_options(), 40, 1.1);
  options.soft.hardening_exponent = 0.05;  // the plastic strain grows with the 20th power of the stress
  options.initial_temperature = 900.0;
  Rig rig(options);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.pressure[l] = 5e9;
    rig.inputs.velocity_jump[l] = 20.0 + 10.0 * l;
  }
  for (int n = 0; n < 100; ++n) rig.step(1e-9);
  rig.set_all(0.0, 5e9);
  constexpr double kShort = 1e-11;
  for (int n = 0; n < 300; ++n) {
    double before[kLanes];
    for (int l = 0; l < kLanes; ++l) before[l] = rig.stress(l);
    rig.step(kShort);
    for (int l = 0; l < kLanes; ++l) {
      const double relaxed = options.grid.thickness * (before[l] - rig.stress(l)) / options.soft.shear_modulus;
      ASSERT_GT(relaxed, 0.0);
      EXPECT_NEAR(rig.outputs.sliding_velocity[l] * kShort, relaxed, 1e-7 * relaxed) << "step " << n << ", lane " << l;
    }
  }
}

// Rounding may leave the stress of a slipping interface a few ulps below mu P. Here the stress before the step is up to
// seven ulps below mu P; the step must nevertheless slip at mu P.
TEST(PhysicsVelocityDriven, AStressJustBelowItsBoundDoesNotSwallowTheSlip) {
  ModelOptions options = graded(paper_options());
  options.friction_coefficient = 0.01;
  Rig rig(options);
  rig.set_all(1e-3, 11.2e9);
  const double bound = 0.01 * 11.2e9;
  for (int l = 0; l < kLanes; ++l) {
    double start = bound;
    for (int ulps = 0; ulps < l; ++ulps) start = std::nextafter(start, 0.0);
    rig.committed[rig.model.layout().shear_stress + l] = start;
  }
  rig.step(1e-9);
  for (int l = 0; l < kLanes; ++l) {
    EXPECT_EQ(rig.outputs.regime[l], Regime::kCoulomb) << l;
    EXPECT_NEAR(rig.outputs.sliding_velocity[l], 1e-3, 1e-8) << l;
  }
}

// A step begins its search at the stress before the step. Here this stress would bring the interface to within a
// fraction of a kelvin of melting, where the last digit of the stress changes the flow by any amount; yet it is no
// answer, because the layer would flow by far too much.
TEST(PhysicsVelocityDriven, AStressThatWouldMeltTheLayerIsNoAnswer) {
  const double dt = 1e-9, T_before = 1200.0;
  Figures figures;
  Rig rig(graded(paper_options()));
  const ModelOptions& options = rig.model.options();
  rig.set_all(1e4, 11.2e9);
  rig.operators = rig.model.operators(dt);
  const double rise =
      heat_partition(options.soft, options.hard) * 1e4 * rig.operators->heat().layer_response()[0];  // [K/Pa]
  for (double below = 1e-9; below < 0.1; below *= 1.01) {
    double T[kLanes];
    for (int l = 0; l < kLanes; ++l) T[l] = T_before;
    rig.start(T);
    for (int l = 0; l < kLanes; ++l) {
      const double T_guess = options.soft.melting_temperature - below * (1.0 + 0.1 * l);
      rig.committed[rig.model.layout().shear_stress + l] = (T_guess - T_before) / rise;
    }
    rig.step(dt);
    for (int l = 0; l < kLanes; ++l) ASSERT_NO_THROW(require_invariants(rig, l, dt, figures)) << below;
  }
  EXPECT_LT(figures.nearest_melting, 1.0);
}

// Within a kelvin of melting the strength falls by hundreds of powers of ten; the search must find a stress so far below
// the stress before the step.
TEST(PhysicsVelocityDriven, ALayerAlmostMoltenBeforeTheStepHasAnAnswer) {
  Figures figures;
  Rig rig(graded(paper_options()));
  rig.set_all(100.0, 11.2e9);
  for (double below = 1e-4; below < 3.0; below *= 1.1) {
    double T[kLanes];
    for (int l = 0; l < kLanes; ++l) T[l] = rig.model.options().soft.melting_temperature - below * (1.0 + 0.01 * l);
    rig.start(T);
    std::fill_n(rig.committed.data() + rig.model.layout().shear_stress, kLanes, 2e8);
    rig.step(1e-9);
    for (int l = 0; l < kLanes; ++l) ASSERT_NO_THROW(require_invariants(rig, l, 1e-9, figures)) << below;
  }
  EXPECT_LT(figures.nearest_melting, 1e-3);
}

}  // namespace
}  // namespace shearbus::testing
