// Steps layers with inertia in random scenes, states and inputs: every equation of a step must hold to rounding. The
// steps are of backward Euler; physics_waves_stages.cpp tests those of two stages.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <string>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"
#include "tests/support/random_physics.hpp"
#include "tests/support/wave_stage.hpp"

namespace shearbus::testing {
namespace {

class PhysicsWaves : public ::testing::TestWithParam<bool> {};

TEST_P(PhysicsWaves, EveryEquationHoldsForRandomScenesAndInputs) {
  const bool extreme = GetParam();
  Draw draw(41 + (extreme ? 1 : 0));
  double momentum = 0.0, kinematic = 0.0, energy = 0.0, apart = 0.0;
  int steps = 0, flowing = 0, slipping = 0, melting = 0, guarded = 0, failed = 0, reversed = 0, most = 0;
  long iterations = 0;
  for (int scene = 0; scene < 220; ++scene) {
    Rig rig(of_first_order(random_inertia_options(draw, extreme)));
    for (int n = 0; n < 25; ++n) {
      random_inputs(draw, rig, extreme);
      const double dt = random_dt(draw, extreme);
      rig.operators = rig.model.operators(dt);
      std::deque<WaveStage> solved;  // not a vector, which would move a stage: it holds pointers into itself
      for (int l = 0; l < kLanes; ++l) solved.emplace_back(rig, l);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        if (rig.inputs.pressure[l] <= 0.0) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        WaveStage& step = solved[static_cast<std::size_t>(l)];
        step.solve();
        if (rig.outputs.outcome[l] & kFailed) {  // inputs far outside physics: the state is kept
          ASSERT_FALSE(step.answer().found);
          for (int i = 0; i <= step.cells(); ++i) ASSERT_EQ(stress_at(rig, i, l), step.stress_before(i));
          ++failed;
          continue;
        }
        ASSERT_TRUE(step.answer().found);
        momentum = std::max(momentum, step.momentum_fault());
        kinematic = std::max(kinematic, step.kinematic_fault());
        energy = std::max(energy, step.energy_fault());
        ASSERT_LE(step.momentum_fault(), extreme ? 1e-6 : 1e-8);
        ASSERT_LE(step.kinematic_fault(), 1e-12);
        ASSERT_LE(step.energy_fault(), 1e-9);
        step.expect_flow_law();
        // The step of the whole tile, by Newton's method of the lanes together where that finds an answer, must give this lane the
        // same results as the step of the lane alone.
        ASSERT_GE(rig.outputs.shear_stress[l] * rig.outputs.sliding_velocity[l], 0.0);
        if (std::abs(stress_at(rig, 0, l)) >= kNoStress) {
          ASSERT_EQ(rig.outputs.shear_stress[l], stress_at(rig, 0, l));
        }
        ASSERT_NEAR(rig.outputs.friction_heat[l], step.answer().flux * dt, 1e-8 * step.heat_size());
        ASSERT_NEAR(step.answer().flux,
                    step.step().heat_share * std::max(0.0, step.fields().stress[0] * step.step().jump),
                    1e-9 * step.answer().flux + 1e-30);
        for (int i = 0; i <= step.cells(); ++i) {
          if (rig.model.options().soft.melting_curve == MeltingCurve::kConstant) {
            ASSERT_LT(rig.T(i, l), rig.model.options().soft.melting_temperature);
          }
          ASSERT_GE(rig.ep(i, l), step.fields().strain[i]);
          const double stress = std::abs(stress_at(rig, i, l) - step.fields().stress[i]);
          const double flow = std::abs(rig.ep(i, l) - step.fields().strain[i] - step.fields().strain_growth[i]);
          apart = std::max({apart, stress / step.stress_size(i), flow / step.strain_size(i)});
          ASSERT_LE(stress, 1e-8 * step.stress_size(i)) << i;
          ASSERT_LE(flow, 1e-8 * step.strain_size(i)) << i;
        }
        if (::testing::Test::HasFatalFailure()) return;
        ++steps;
        iterations += step.answer().iterations;
        most = std::max(most, step.answer().guarded ? 0 : step.answer().iterations);
        guarded += step.answer().guarded;
        flowing += rig.outputs.regime[l] == Regime::kTresca;
        slipping += rig.outputs.regime[l] == Regime::kCoulomb;
        melting += rig.outputs.regime[l] == Regime::kMelting;
        const auto [low, high] = std::minmax_element(step.fields().stress, step.fields().stress + step.cells() + 1);
        reversed += *low * *high < 0.0;
      }
    }
  }
  std::printf(
      "%d node-steps: tresca %d, coulomb %d, melting %d, stress of both signs %d; %.2f Newton steps each, at most %d, "
      "guarded %d, failed %d; worst momentum %.1e, kinematics %.1e, energy %.1e; tile and lane %.1e apart\n",
      steps, flowing, slipping, melting, reversed, static_cast<double>(iterations) / steps, most, guarded, failed,
      momentum, kinematic, energy, apart);
  EXPECT_GT(std::min({flowing, slipping, melting, reversed}), 100);
  EXPECT_LT(guarded, steps / 500);
  EXPECT_LE(failed, extreme ? steps / 5000 : 0);
}

// A step with inertia is solved by Newton's method and, if this fails, by a bracketing search. Both must find the same
// answer.
TEST_P(PhysicsWaves, TheSearchThatCannotFailFindsTheSameAnswer) {
  const bool extreme = GetParam();
  Draw draw(43 + (extreme ? 1 : 0));
  int compared = 0, heated = 0;
  double worst = 0.0;
  for (int scene = 0; scene < 15; ++scene) {
    Rig rig(of_first_order(random_inertia_options(draw, extreme)));
    for (int n = 0; n < 12; ++n) {
      random_inputs(draw, rig, extreme);
      rig.operators = rig.model.operators(random_dt(draw, extreme));
      for (int l = 0; l < kLanes; l += 3) {
        if (rig.inputs.pressure[l] <= 0.0) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        WaveStage fast(rig, l), sure(rig, l);
        fast.solve();
        sure.solve(0);
        ASSERT_TRUE(sure.answer().guarded);
        const double size = fast.largest_stress() + kLeastStress;
        for (int i = 0; i <= fast.cells(); ++i) {
          const double apart = std::abs(fast.fields().stress[i] - sure.fields().stress[i]) / size;
          worst = std::max(worst, apart);
          ASSERT_LE(apart, 1e-7) << "vertex " << i;
        }
        ASSERT_NEAR(fast.T(0), sure.T(0), 1e-9);
        ++compared;
        heated += fast.answer().flux > 0.0;
      }
      rig.step(rig.operators->dt());
    }
  }
  std::printf("%d node-steps, %d heated: stresses at most %.1e apart\n", compared, heated, worst);
  EXPECT_GT(heated, 80);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsWaves, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "Extreme" : "Usual"; });

}  // namespace
}  // namespace shearbus::testing
