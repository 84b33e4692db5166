// Velocity-weakening friction (MODEL.md) in the force-driven step.
#include "server/physics/interface/stress_limit.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr InterfaceOptions kPaper{0.3, 1e12, FrictionLaws::place<VelocityWeakening>(), 0.02, 0.01};

// The search finds the answer with the most slip without a scan, and tells whether there are others: a scan of each step
// must agree. The interface heats, so that both friction and yield limit it.
TEST(PhysicsVelocityWeakening, EveryAnswerOfAStepIsFound) {
  Draw draw(17);
  const Material soft = paper_options().soft;
  constexpr int kPoints = 2000;
  int several = 0, single = 0, none = 0;
  for (int n = 0; n < 3000; ++n) {
    InterfaceOptions law = kPaper;
    law.yield_strength = draw.chance(0.5) ? 1e12 : draw.log_uniform(1e8, 3e9);
    const double P = draw.log_uniform(1e8, 1e11);
    const StressLimit limit = interface_strength(law, soft, P, nullptr);
    const FrictionHeating heating{draw.uniform(300.0, 1200.0), draw.log_uniform(1e-10, 1e-8), draw.uniform(1.0, 400.0),
                                  draw.log_uniform(1e-9, 1e-6)};
    const double a_max = std::min(heating.c / heating.b, 1.01 * limit.at(heating.T_ad, 0.0).stress);
    int zeros = 0;
    double first = a_max, nearest = a_max;  // the first zero, and the least distance between two
    bool spare = true;
    for (int i = 1; i <= kPoints; ++i) {
      const double a = a_max * i / kPoints;
      if ((spare_strength(limit, heating, a) > 0.0) == spare) continue;
      spare = !spare;
      if (zeros++ == 0) first = a;
      if (zeros == 2) nearest = a - first;
    }
    const SlipSearch slip = most_slip_stress(limit, heating, a_max);
    ASSERT_LE(slip.stress, first) << n;
    if (slip.stress < first * (1.0 - 1e-9) - a_max / kPoints) {  // two zeros between two points of the scan
      ASSERT_TRUE(slip.found && slip.several) << n;
    } else {
      ASSERT_EQ(slip.found, zeros > 0) << n;
      if (nearest > 3.0 * a_max / kPoints) {
        ASSERT_EQ(slip.several, zeros > 1) << n;
      }
    }
    if (slip.found) {
      ASSERT_NEAR(spare_strength(limit, heating, slip.stress), 0.0, 1e-9 * slip.stress + 1e-6) << n;
    }
    (zeros > 1 ? several : zeros == 1 ? single : none) += 1;
  }
  EXPECT_GT(several, 50);
  EXPECT_GT(single, 500);
  EXPECT_GT(none, 50);
}

// A node whose step may have two answers: to stick under the friction at rest, or to slide under a lower friction. A
// sticking interface must go on sticking, and a sliding interface must go on sliding.
struct TwoAnswers {
  TwoAnswers() : rig(options(), 1) {
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 6.8e-3;
    rig.inputs.pressure[0] = 1e9;
  }
  static ModelOptions options() {
    ModelOptions o = graded(paper_options(Strategy::kForceDriven));
    o.interface = kPaper;
    o.interface.velocity_decay = 1.0;  // friction falls within a few m/s
    return o;
  }
  // Steps the node from the given jump [m/s] under the far stress `pull` [Pa] on both bodies.
  void step(double jump, double pull, double dt) {
    rig.inputs.velocity_jump[0] = jump;
    rig.inputs.stress_soft[0] = rig.inputs.stress_hard[0] = pull;
    rig.step(dt);
  }
  Rig rig;
};

TEST(PhysicsVelocityWeakening, AStuckInterfaceHoldsUpToTheFrictionOfRest) {
  TwoAnswers node;
  node.step(0.0, 299e6, 1e-9);
  EXPECT_EQ(node.rig.outputs.regime[0], Regime::kStick);
  EXPECT_DOUBLE_EQ(node.rig.outputs.shear_stress[0], 299e6);
  EXPECT_EQ(node.rig.outputs.velocity_jump_new[0], 0.0);
  node.step(0.0, 301e6, 1e-9);
  EXPECT_EQ(node.rig.outputs.regime[0], Regime::kCoulomb);
  EXPECT_GT(node.rig.outputs.velocity_jump_new[0], 0.0);
}

TEST(PhysicsVelocityWeakening, ASlippingInterfaceGoesOnSlippingWhereItCould) {
  TwoAnswers node;
  // The bodies slide at 20 m/s under far stresses of 100 MPa. Friction at rest (300 MPa) could hold them, but at this
  // speed friction carries only 20 MPa.
  double jump = 20.0;
  for (int n = 0; n < 20; ++n) {
    node.step(jump, 100e6, 1e-9);
    ASSERT_EQ(node.rig.outputs.regime[0], Regime::kCoulomb) << n;
    ASSERT_GT(node.rig.outputs.velocity_jump_new[0], jump) << n;
    jump = node.rig.outputs.velocity_jump_new[0];
  }
  EXPECT_NEAR(node.rig.outputs.shear_stress[0], 20e6, 1e4);
}

// A step in which the interface could stick or slide is divided until each substep has one answer, and the outcome
// reports the division.
TEST(PhysicsVelocityWeakening, AnAmbiguousStepIsDividedAndSaysSo) {
  TwoAnswers coarse;
  coarse.step(2.0, 100e6, 1e-9);
  EXPECT_TRUE(coarse.rig.outputs.outcome[0] & kSubstepped);
  TwoAnswers fine;
  double jump = 2.0;
  for (int n = 0; n < 1000; ++n) {
    fine.step(jump, 100e6, 1e-12);
    ASSERT_EQ(fine.rig.outputs.outcome[0], 0) << n;
    jump = fine.rig.outputs.velocity_jump_new[0];
  }
  EXPECT_GT(jump, 10.0);
  EXPECT_NEAR(coarse.rig.outputs.velocity_jump_new[0], jump, 0.02 * jump);
}

// If even the shortest substep has two answers, a sliding interface continues to slide, and the outcome reports that
// there was a choice.
TEST(PhysicsVelocityWeakening, AnUnresolvedChoiceIsTold) {
  TwoAnswers node;
  for (double* mass : {node.rig.inputs.mass_soft, node.rig.inputs.mass_hard}) mass[0] = 1e-5;
  node.step(2.0, 100e6, 1e-9);
  EXPECT_EQ(node.rig.outputs.outcome[0], kSubstepped | kMultipleRoots);
  EXPECT_EQ(node.rig.outputs.regime[0], Regime::kCoulomb);
}

}  // namespace
}  // namespace shearbus::testing
