// server/physics/MODEL.md, "What always holds", over random scenes, states and inputs.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/support/random_history.hpp"

namespace shearbus::testing {
namespace {

constexpr int kScenes = 120;
constexpr int kSteps = 25;
struct Case {
  Strategy strategy;
  bool extreme;
};
void PrintTo(const Case& c, std::ostream* os) {
  *os << (c.strategy == Strategy::kVelocityDriven ? "VelocityDriven" : "ForceDriven") << (c.extreme ? "Extreme" : "");
}

class PhysicsInvariants : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsInvariants, HoldForRandomScenesAndInputs) {
  const auto [strategy, extreme] = GetParam();
  Draw draw(2024 + (extreme ? 1 : 0));
  Figures figures;
  for (int scene = 0; scene < kScenes; ++scene) {
    Rig rig(random_options(draw, strategy, extreme));
    start_hard_elsewhere(draw, rig);
    try {
      random_history(draw, rig, extreme, kSteps, figures, [] {});
    } catch (const Broken& broken) {
      FAIL() << "scene " << scene << ", " << broken.what();
    }
  }
  std::printf(
      "%ld node-steps: stick %ld, coulomb %ld, tresca %ld, melting %ld, divided %ld; %ld of %ld layers held to (64); "
      "heat balance %.1e\n",
      figures.node_steps, figures.regime(Regime::kStick), figures.regime(Regime::kCoulomb),
      figures.regime(Regime::kTresca), figures.regime(Regime::kMelting), figures.divided, figures.flowing_resolved,
      figures.flowing, figures.heat_residual);
  EXPECT_GE(10 * figures.flowing_resolved, 6 * figures.flowing);
  // The draws reach every regime: an invariant of a regime never visited would be no test.
  for (const Regime regime : {Regime::kStick, Regime::kCoulomb, Regime::kTresca, Regime::kMelting})
    EXPECT_GT(figures.regime(regime), 100);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsInvariants,
                         ::testing::Values(Case{Strategy::kVelocityDriven, false},
                                           Case{Strategy::kVelocityDriven, true}, Case{Strategy::kForceDriven, false},
                                           Case{Strategy::kForceDriven, true}),
                         [](const auto& test) { return ::testing::PrintToString(test.param); });

}  // namespace
}  // namespace shearbus::testing
