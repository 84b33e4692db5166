// Velocity-weakening friction (MODEL.md) in the force-driven step.
#include "server/physics/interface/velocity_weakening.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr InterfaceOptions kPaper{0.3, 1e12, FrictionLaws::place<VelocityWeakening>(), 0.02, 0.01};

TEST(PhysicsVelocityWeakening, EveryAnswerOfAStepIsFound) {
  Draw draw(17);
  int several = 0;
  for (int n = 0; n < 3000; ++n) {
    const double P = draw.log_uniform(1e8, 1e11), c = draw.uniform(-20.0, 400.0), b = draw.log_uniform(1e-9, 1e-6);
    const double a_stick = draw.log_uniform(1e6, 1e11);
    const VelocityWeakening law{0.3, 0.02, 0.01};
    const SlidingFriction friction = VelocityWeakening::of_step(kPaper, P, c, b, a_stick);
    const auto h = [&](double a) { return law.coefficient(std::max(0.0, c - b * a)) * P - a; };
    EXPECT_NEAR(friction.holding, h(a_stick) + a_stick, 1e-9 * P);
    EXPECT_NEAR(h(friction.sliding), 0.0, 1e-11 * P);
    for (int i = 0; i < 300; ++i) ASSERT_GT(h(friction.sliding * (i + 0.5) / 300.5), 0.0);
    // h(a) is friction minus stress. While the interface slips (a < c / b), h must be negative for stresses between
    // `sliding` and `exceeds_again`, and positive above `exceeds_again`.
    const double end = std::min(c / b, 2.0 * 0.3 * P);
    for (int i = 1; i < 300 && friction.sliding < end; ++i) {
      const double a = friction.sliding + (end - friction.sliding) * i / 300;
      if (std::abs(a / friction.exceeds_again - 1.0) < 1e-9 || a / friction.sliding - 1.0 < 1e-9) continue;
      ASSERT_EQ(h(a) > 0.0, a > friction.exceeds_again) << "c " << c << " b " << b << " P " << P << " a " << a;
    }
    several += std::isfinite(friction.exceeds_again);
  }
  EXPECT_GT(several, 50);
}

TEST(PhysicsVelocityWeakening, WithoutDecayItIsCoulombsLaw) {
  ModelOptions constant = graded(paper_options(Strategy::kForceDriven));
  constant.interface.yield_strength = 1e9;
  constant.interface.friction_coefficient = 0.02;
  ModelOptions weakening = constant;
  weakening.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  weakening.interface.friction_coefficient_fast = 0.01;
  weakening.interface.velocity_decay = 0.0;
  Rig one(constant), other(weakening);
  for (int n = 0; n < 200; ++n) {
    for (Rig* rig : {&one, &other}) {
      rig->set_all(50.0 - 0.3 * n, 11.2e9);
      rig->step(1e-9);
    }
    for (std::size_t i = 0; i < one.committed.size(); ++i) {
      ASSERT_NEAR(other.committed[i], one.committed[i], 1e-13 * std::abs(one.committed[i])) << n;
    }
  }
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
