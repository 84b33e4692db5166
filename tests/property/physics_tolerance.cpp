// Steps with a tolerance: the fast solver and the slow reference model choose the same substeps and find the same
// answers, the substeps of a lane do not depend on other lanes, and the invariants of a step hold.
#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "tests/support/invariants.hpp"
#include "tests/support/random_physics.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::testing {
namespace {

// Steps that cost the fast solver more evaluations than this are not compared with the slow reference model.
constexpr int kMostEffort = 3000;

ModelOptions controlled(Draw& draw, Strategy strategy) {
  ModelOptions options = random_options(draw, strategy, false);
  options.taylor_quinney_factor.reset();
  options.tolerance = draw.log_uniform(1e-5, 1e-2);
  options.grid.cells = draw.integer(1, 16);
  // The strain increment DLP (48) divides by the hardening coefficient, which therefore must not be 0.
  if (options.soft.hardening_coefficient == 0.0) options.soft.hardening_coefficient = 125.0;
  // Under a tolerance a step of a plastic layer takes up to a second if its flow law couples rate and temperature.
  // PhysicsCombinations tests this combination in shorter histories.
  if (!properties_of(options.soft.flow_law).separable) options.plastic_layer = false;
  return options;
}

class PhysicsTolerance : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsTolerance, FastAndSlowAgreeOnHowFineAndOnTheAnswer) {
  Draw draw(91);
  int compared = 0, finer = 0, apart = 0;
  double worst = 0.0;
  for (int scene = 0; scene < 40; ++scene) {
    const ModelOptions options = controlled(draw, GetParam());
    const double T_melt = options.soft.melting_temperature;
    const double range = std::max(T_melt - options.initial_temperature, 0.01 * T_melt);
    Rig rig(options);
    for (int step = 0; step < 6; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      const int l = step;
      reference::NodeState twin_state = rig.node_state(l);
      const reference::NodeInputs twin_inputs = rig.node_inputs(l);
      SearchEffort effort;
      rig.inputs.effort = &effort;
      rig.step(dt);
      if (effort.layer_sums + effort.limit_values > kMostEffort) continue;  // the slow model would take minutes
      const reference::NodeOutputs twin = reference::advance_one(options, dt, twin_inputs, twin_state);
      if ((rig.outputs.outcome[l] & (kSubstepped | kMultipleRoots)) != 0 || twin.answers > 1) continue;
      SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(step) + ", " +
                   std::string(FrictionLaws::name_of(options.interface.friction_law)));
      ++compared;
      finer += twin.error_estimate > 0.25 * *options.tolerance;
      // The fast solver and the reference model choose different substeps in two cases: an error equals its limit
      // except for rounding; or only the fast solver, unable to show that the answer is unique, used the first-order
      // scheme. Even then the two answers must agree within the sum of their error estimates.
      const double difference = std::abs(rig.outputs.interface_temperature[l] - twin.interface_temperature);
      worst = std::max(worst, difference);
      if (difference > 1e-8) {
        ++apart;
        ASSERT_LE(difference, range * (rig.outputs.error_estimate[l] + twin.error_estimate));
        continue;
      }
      // Heat that moves T0 by less than what counts as the same is the same, too.
      const double response =
          options.modes ? rig.operators->modes().response : rig.operators->heat().layer_response()[0];
      EXPECT_NEAR(rig.outputs.friction_heat[l], twin.friction_heat,
                  1e-6 * twin.friction_heat + std::max(1e-9, 1e-8 * dt / response));
      const double driven = dt * (std::abs(rig.inputs.stress_soft[l]) / rig.inputs.mass_soft[l] +
                                  std::abs(rig.inputs.stress_hard[l]) / rig.inputs.mass_hard[l]);
      EXPECT_NEAR(rig.outputs.velocity_jump_new[l], twin.velocity_jump_new,
                  1e-8 * (std::abs(twin.velocity_jump_new) + std::abs(rig.inputs.velocity_jump[l])) + 1e-10 * driven);
      // If only the fast solver fell back to the first-order scheme (because it could not show that the answer is
      // unique), the error estimates are not comparable.
      if (twin.first_order != ((rig.outputs.outcome[l] & kFirstOrder) != 0)) continue;
      // If the new jump is mere rounding, its sign is arbitrary, and the error estimates are not comparable.
      if (std::abs(twin.velocity_jump_new) <= 1e-9 * (driven + std::abs(rig.inputs.velocity_jump[l]))) continue;
      // `grain` allows for the rounding error of the new jump, a difference of velocities. The error estimate contains
      // this rounding error, up to tenfold if the slip stops within the step.
      const double grain =
          300.0 * response * std::abs(twin.shear_stress) * 1e-13 * (driven + std::abs(rig.inputs.velocity_jump[l]));
      EXPECT_NEAR(rig.outputs.error_estimate[l], twin.error_estimate,
                  1e-6 * twin.error_estimate + 2e-8 + grain / range);
    }
  }
  std::printf("%d node-steps compared, %d at the last halving, %d apart: worst T0 %.1e K\n", compared, finer, apart,
              worst);
  EXPECT_GT(compared, 150);
  EXPECT_LT(apart, compared / 20);
}

// A push against the slip stops it within the step, and would have turned it. Friction f = mu P then does the work of the
// way until the stop, t = V / (push + f (1/m_soft + 1/m_hard)), which no piece of the step sees whose push alone turns it.
TEST(PhysicsToleranceOfAStop, TheHeatOfSlipThatStopsInTheStepIsKept) {
  Draw draw(95);
  double worst[3] = {}, largest = 0.0;
  for (int node = 0; node < 80; ++node) {
    const double tolerances[] = {1e-3, 1e-4, 1e-5};
    const double T_start = draw.chance(0.5) ? 300.0 : draw.uniform(1100.0, 1210.0);
    const double V = draw.sign() * draw.uniform(2.0, 20.0), mu = 0.02, P = 2e9;
    const double push = -std::copysign(draw.uniform(15e6, 35e6), V), m = draw.uniform(0.005, 0.02), dt = 20e-9;
    for (int k = 0; k < 3; ++k) {
      ModelOptions options = paper_options(Strategy::kForceDriven);
      options.initial_temperature = T_start;
      options.interface = {mu, 1e12};
      options = discretised(options, tolerances[k]);
      Rig rig(options, 1);
      rig.set_all(V, P);
      rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = m;
      rig.inputs.stress_soft[0] = push;
      rig.inputs.stress_hard[0] = 0.0;
      rig.step(dt);
      const double slows = (std::abs(push) + 2.0 * mu * P) / m, until = std::abs(V) / slows;
      ASSERT_LT(until, dt);
      ASSERT_EQ(rig.outputs.velocity_jump_new[0], 0.0) << node;
      const double heat = rig.conducted_share() * mu * P * 0.5 * std::abs(V) * until;
      const double response =
          options.modes ? rig.operators->modes().response : rig.operators->heat().layer_response()[0];
      const double range = std::max(1220.0 - T_start, 0.01 * 1220.0);
      const double error = response / dt * std::abs(rig.outputs.friction_heat[0] - heat) / range;
      worst[k] = std::max(worst[k], error / tolerances[k]);
      largest = std::max(largest, response / dt * heat / range);
    }
  }
  std::printf("heat of slip that stops: worst error over the tolerance %.2g %.2g %.2g, of a heat up to %.2g\n",
              worst[0], worst[1], worst[2], largest);
  for (const double one : worst) EXPECT_LE(one, 1.0);
  EXPECT_GT(largest, 3e-3);
}

TEST_P(PhysicsTolerance, ALaneAloneHasTheSameBits) {
  Draw draw(92);
  for (int scene = 0; scene < 30; ++scene) {
    const ModelOptions options = controlled(draw, GetParam());
    Rig rig(options);
    for (int step = 0; step < 6; ++step) {
      random_inputs(draw, rig, false);
      const int l = draw.integer(0, kLanes - 1);
      Rig alone(options, 1u << l);
      alone.inputs = rig.inputs;
      alone.inputs.active = 1u << l;
      alone.committed = rig.committed;
      const double dt = random_dt(draw, false);
      rig.step(dt);
      alone.step(dt);
      for (std::size_t i = static_cast<std::size_t>(l); i < rig.committed.size(); i += kLanes) {
        ASSERT_EQ(rig.committed[i], alone.committed[i]) << scene << " " << step;
      }
      ASSERT_EQ(rig.outputs.error_estimate[l], alone.outputs.error_estimate[l]);
      ASSERT_EQ(rig.outputs.shear_stress[l], alone.outputs.shear_stress[l]);
      ASSERT_EQ(rig.outputs.outcome[l], alone.outputs.outcome[l]);
    }
  }
}

TEST_P(PhysicsTolerance, WhatHoldsForAStepHoldsForItsSubsteps) {
  Draw draw(93);
  Figures figures;
  for (int scene = 0; scene < 40; ++scene) {
    const ModelOptions options = controlled(draw, GetParam());
    Rig rig(options);
    for (int step = 0; step < 10; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_NO_THROW(require_invariants(rig, l, dt, figures)) << scene << " " << step;
        ASSERT_EQ(rig.outputs.interface_temperature[l], rig.T(0, l));
        ASSERT_EQ(rig.outputs.shear_stress[l], rig.stress(l));
        ASSERT_TRUE(rig.outputs.error_estimate[l] >= 0.0);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, PhysicsTolerance, support::both<Strategy>(), support::name_of_strategy);

}  // namespace
}  // namespace shearbus::testing
