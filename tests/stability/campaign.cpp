// Every row of the stability campaign on every physics it is about.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

void PrintTo(const Row& row, std::ostream* os) {
  *os << row.what;
}

namespace {

constexpr int kMostSteps = 10000;  // shearbus-study stability takes all

class Campaign : public ::testing::TestWithParam<Row> {};

TEST_P(Campaign, HoldsOnEveryPhysics) {
  int asked = 0;
  for (const Physics& physics : all_physics()) {
    const Outcome outcome = run(GetParam(), physics, kMostSteps);
    asked += outcome.verdict != Verdict::kNotAsked;
    EXPECT_TRUE(outcome.verdict == Verdict::kHeld || outcome.verdict == Verdict::kNotAsked)
        << physics.name << ": " << outcome.reason;
  }
  EXPECT_GT(asked, 0);
}

INSTANTIATE_TEST_SUITE_P(, Campaign, ::testing::ValuesIn(all_rows()), [](const auto& row) { return row.param.name; });

// What the work of a row is bounded by, against the half-space whose interface is at melting: by
//   2 k/sqrt(alpha) (T_melt - T_ref) sqrt(t/pi).
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
    // Backward Euler's first step takes sqrt(pi)/2 of it; later it is ahead by 1/(8n) at most, and the grid a little.
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
