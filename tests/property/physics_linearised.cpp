// The linearised answer against differences of answers, over random histories of every model that has one, and what a
// host gains by it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// The answers with one input moved by +-kShare of itself give two one-sided differences. Where these differ by more than
// kKink of the larger the answer has a kink or bends too strongly to be compared.
constexpr double kShare = 1e-4;
constexpr double kKink = 1e-2;
constexpr double kAgrees = 1e-3;     // largest error of a derivative, relative to the difference
constexpr double kUnresolved = 0.1;  // distance of T0 from melting below which answers are not compared  [K]
constexpr double kTypical = 1e-6;    // largest median of these errors

// Draws options whose answers can be linearised.
ModelOptions linearised_options(Draw& draw, Strategy strategy) {
  ModelOptions options = random_options(draw, strategy, false);
  options.drive = Drive::kLayerShear;
  options.time_integrator = TimeIntegrator::kBackwardEuler;
  options.taylor_quinney_factor.reset();
  options.plastic_layer = false;
  options.melt_film.reset();
  if (strategy == Strategy::kVelocityDriven) {  // the contact of a layer slips under mu P, if it slips
    options.interface.friction_law = {};
    options.junctions.reset();
  }
  EXPECT_TRUE(Model::can_linearise(options));
  return options;
}

struct Comparison {
  std::vector<double> errors;
  int kinks = 0;
  int zeros = 0;  // both the derivative and the difference are 0
};

// Compares d(stress)/d(input) of all lanes of the last step with differences.
void compare(const Rig& rig, double (TileInputs::*input)[kLanes], double (TileOutputs::*derivative)[kLanes],
             Comparison& comparison) {
  const auto stresses = [&](double share) {
    TileInputs moved = rig.inputs;
    for (double& value : moved.*input) value *= 1.0 + share;
    std::vector<double> trial(rig.committed.size());
    TileOutputs outputs{};
    rig.model.advance(*rig.operators, moved, rig.trial.data(), trial.data(), outputs);  // `trial`: the state before
    return std::vector<double>(outputs.shear_stress, outputs.shear_stress + kLanes);
  };
  const std::vector<double> less = stresses(-kShare), more = stresses(kShare);
  for (int l = 0; l < kLanes; ++l) {
    if ((rig.outputs.outcome[l] & (kFailed | kSubstepped)) != 0) continue;
    // So close to melting the last digit of T0 moves the stress by more than the input does.
    const double melting = at_pressure(rig.model.options().soft, rig.inputs.pressure[l]).melting_temperature;
    if (rig.outputs.interface_temperature[l] > melting - kUnresolved) continue;
    const double step = kShare * (rig.inputs.*input)[l], s = rig.outputs.shear_stress[l];
    if (step == 0.0) continue;
    const double below = (s - less[static_cast<std::size_t>(l)]) / step;
    const double above = (more[static_cast<std::size_t>(l)] - s) / step;
    const double found = (rig.outputs.*derivative)[l];
    // Rounding of the stress, which an answer has to 1e-9 of it.
    const double grain = 1e-9 * std::abs(s / step);
    const double size = std::max(std::abs(below), std::abs(above));
    if (size <= grain) {
      EXPECT_LE(std::abs(found), 2.0 * grain) << "lane " << l << ", regime " << static_cast<int>(rig.outputs.regime[l]);
      ++comparison.zeros;
    } else if (std::abs(above - below) > kKink * size + 2.0 * grain) {
      ++comparison.kinks;
    } else {
      const double error = std::abs(found - 0.5 * (below + above));
      // A kink within the share lies between the two differences.
      const double outside = std::abs(found - std::clamp(found, std::min(below, above), std::max(below, above)));
      EXPECT_LE(outside, kAgrees * size + 2.0 * grain)
          << "lane " << l << ", regime " << static_cast<int>(rig.outputs.regime[l]) << ", " << below << ", " << above
          << " against " << found << ", T0 " << rig.outputs.interface_temperature[l] << ", s " << s;
      comparison.errors.push_back(error / size);
    }
  }
}

void compare_histories(Strategy strategy, std::uint64_t seed) {
  Comparison by_jump, by_pressure;
  for (std::uint64_t scene = 0; scene < 150; ++scene) {
    Draw draw(seed + scene);
    Rig rig(linearised_options(draw, strategy));
    for (int step = 0; step < 12; ++step) {
      random_inputs(draw, rig, false);
      rig.step(std::max(random_dt(draw, false), shortest_step(rig.model.options())));
      rig.model.linearise(*rig.operators, rig.inputs, rig.trial.data(), rig.committed.data(), rig.outputs);
      compare(rig, &TileInputs::velocity_jump, &TileOutputs::stress_per_jump, by_jump);
      compare(rig, &TileInputs::pressure, &TileOutputs::stress_per_pressure, by_pressure);
      if (::testing::Test::HasFailure()) {
        ADD_FAILURE() << "seed " << seed + scene << ", step " << step;
        return;
      }
    }
  }
  for (Comparison* comparison : {&by_jump, &by_pressure}) {
    const std::size_t compared = comparison->errors.size();
    ASSERT_GT(compared, 500u);
    EXPECT_LT(static_cast<std::size_t>(comparison->kinks), compared / 5);
    std::ranges::nth_element(comparison->errors,
                             comparison->errors.begin() + static_cast<std::ptrdiff_t>(compared / 2));
    EXPECT_LT(comparison->errors[compared / 2], kTypical);
  }
}

TEST(PhysicsLinearised, VelocityDrivenDerivativesAreThoseOfTheAnswer) {
  compare_histories(Strategy::kVelocityDriven, 70'000);
}

TEST(PhysicsLinearised, ForceDrivenDerivativesAreThoseOfTheAnswer) {
  compare_histories(Strategy::kForceDriven, 71'000);
}

// A body of mass m per area, braked by a layer: m dV/dt = -s. Taken as constant, the stress of an elastic layer makes
// its jump grow without bound where dt is above 4 m / (ds/d[V]); with the derivative it is bounded in one pass a step.
TEST(PhysicsLinearised, OnePassOfAnImplicitHostIsStable) {
  const double mass = 2e-4, dt = 1e-9;
  double largest[2] = {};
  for (const bool implicit : {false, true}) {
    Rig rig(graded(paper_options(), 30, 1.1), 1);
    double jump = 1.0;
    for (int step = 0; step < 40; ++step) {
      rig.set_all(jump, 5e9);
      rig.step(dt);
      rig.model.linearise(*rig.operators, rig.inputs, rig.trial.data(), rig.committed.data(), rig.outputs);
      const double stiffness = implicit ? rig.outputs.stress_per_jump[0] : 0.0;
      ASSERT_GT(rig.outputs.stress_per_jump[0], 4.0 * mass / dt);
      jump -= dt * rig.stress() / (mass + dt * stiffness);
      largest[implicit] = std::max(largest[implicit], std::abs(jump));
      if (largest[implicit] > 50.0) break;
    }
  }
  EXPECT_GT(largest[0], 50.0);
  EXPECT_LE(largest[1], 1.5);
}

TEST(PhysicsLinearised, TimeToMeltingIsThatOfTheRateOfTheStep) {
  Rig rig(graded(paper_options(), 30, 1.1), 0b111);
  rig.set_all(100.0, 5e9);
  rig.inputs.velocity_jump[1] = 0.0;
  rig.inputs.pressure[2] = -1.0;
  for (int step = 0; step < 100; ++step) {
    const double before = rig.T(0);
    rig.step(1e-9);
    rig.model.predict_melting(*rig.operators, rig.inputs, rig.trial.data(), rig.outputs);
    EXPECT_NEAR(rig.T(0) + rig.outputs.time_to_melting[0] * (rig.T(0) - before) / 1e-9, 1220.0, 1e-9);
    EXPECT_EQ(rig.outputs.time_to_melting[1], std::numeric_limits<double>::infinity());
    EXPECT_EQ(rig.outputs.time_to_melting[2], std::numeric_limits<double>::infinity());
  }
}

}  // namespace
}  // namespace shearbus::testing
