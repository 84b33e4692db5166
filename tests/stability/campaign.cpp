// Runs every row (load history) of the stability campaign on every physics (combination of options) that it suits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

void PrintTo(const Row& row, std::ostream* os) {
  *os << row.what;
}

namespace {

// A row is a load history of the campaign, a physics a combination of options and laws. "shearbus-study stability" runs
// all steps of every row on every physics; this test must take less time. A flow law that couples rate and temperature
// takes 2 to 3 times as long as another law, and a tolerance may divide a step into thousands of substeps. With such a
// law the test therefore runs at most kMostStepsCoupled steps. It then runs rows of several scenes only without
// tolerance, sleep, conducting hard body and second component, and the row variable_step only without tolerance.
constexpr int kMostSteps = 10000;
constexpr int kMostStepsCoupled = 200;

// A layer that flows under force to a tolerance takes some thousand times as long as the same layer without one.
bool takes_long(const Physics& physics) {
  return physics.options.tolerance && physics.options.plastic_layer;
}

bool is_run(const Row& row, const Physics& physics) {
  const ModelOptions& o = physics.options;
  if (takes_long(physics)) return false;
  if (testing::properties_of(o.soft.flow_law).separable) return true;
  const bool plain = !o.tolerance && !o.sleep && !o.hard_grid && o.tangential_components == 1;
  return plain || (row.scenes(physics).size() <= 1 && !(o.tolerance && row.name == "variable_step"));
}

class Campaign : public ::testing::TestWithParam<Row> {};

TEST_P(Campaign, HoldsOnEveryPhysics) {
  int asked = 0;
  for (const Physics& physics : all_physics()) {
    if (!is_run(GetParam(), physics)) continue;
    const bool separable = testing::properties_of(physics.options.soft.flow_law).separable;
    const Outcome outcome = run(GetParam(), physics, separable ? kMostSteps : kMostStepsCoupled);
    asked += outcome.verdict != Verdict::kNotAsked;
    EXPECT_TRUE(outcome.verdict == Verdict::kHeld || outcome.verdict == Verdict::kNotAsked)
        << physics.name << ": " << outcome.reason;
  }
  EXPECT_GT(asked, 0);
}

// The start of every row. What a row is for, it may not reach so soon.
TEST(CampaignOfFewSteps, HoldsWhereALayerFlowsUnderForceToATolerance) {
  constexpr int kSteps = 15, kStepsOfSeveralScenes = 2;
  int asked = 0;
  for (const Physics& physics : all_physics()) {
    if (!takes_long(physics)) continue;
    for (const Row& row : all_rows()) {
      const Outcome outcome = run(row, physics, row.scenes(physics).size() > 1 ? kStepsOfSeveralScenes : kSteps);
      asked += outcome.verdict != Verdict::kNotAsked;
      EXPECT_NE(outcome.verdict, Verdict::kBroken) << row.name << " of " << physics.name << ": " << outcome.reason;
    }
  }
  EXPECT_GE(asked, 20);
}

INSTANTIATE_TEST_SUITE_P(, Campaign, ::testing::ValuesIn(all_rows()), [](const auto& row) { return row.param.name; });

// Friction cannot heat the interface above melting. MoltenLayer computes a bound of the friction heat: the heat that a
// layer takes in while its interface is at melting. For a half-space this bound must agree with the exact heat per
// area, where T_ref is the initial temperature:
//   2 k/sqrt(alpha) (T_melt - T_ref) sqrt(t/pi)
TEST(MoltenLayer, TakesInWhatAMoltenHalfSpaceTakes) {
  testing::ModelOptions options = testing::graded(testing::paper_options());
  options.grid.far_boundary = testing::FarBoundary::kHalfSpace;
  Rig rig(options);
  MoltenLayer molten(rig);
  const double dt = 1e-9;
  const double effusivity = options.soft.conductivity / std::sqrt(options.soft.diffusivity);
  double nearest = 1.0;
  for (int n = 1; n <= 1000; ++n) {
    rig.set_all(1e4, 11.2e9);
    rig.step(dt);
    molten.step(rig);
    const double bound = 2.0 * effusivity * (1220.0 - 300.0) * std::sqrt(n * dt / M_PI);
    // Backward Euler takes in sqrt(pi)/2 of the exact heat in its first step. After n steps its heat is still below the
    // exact heat, by a share of about 1/(8n); the grid adds a little error.
    ASSERT_LE(molten.heat(0), bound * (1.002 + 0.25 / n)) << n;
    nearest = std::min(nearest, std::abs(molten.heat(0) / bound - 1.0));
  }
  EXPECT_LT(nearest, 0.002);
}

TEST(Ringing, IsSeenInWhatAlternatesAndNotInWhatSettles) {
  Ringing alternating, settling, rising;
  double value = 1.0;
  for (int n = 0; n < 100; ++n) {
    alternating.see(n % 2 == 0 ? 1.0 : -1.0, 1.0);
    settling.see(value, 1.0);
    value *= -0.5;
    rising.see(0.1 * n, 1.0);
  }
  EXPECT_TRUE(alternating.rings());
  EXPECT_FALSE(settling.rings());
  EXPECT_FALSE(rising.rings());
}

}  // namespace
}  // namespace shearbus::study::stability
