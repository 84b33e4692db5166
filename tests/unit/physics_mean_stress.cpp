// The mean stress of a step: exact where the path of the stress is known, the answered stress where the host's momentum
// balance takes it as constant, and without effect on any other answer.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// Options of a layer whose limit neither hardens nor softens: Y0 / sqrt(3), and mu P if `mu` is given.
ModelOptions ideally_plastic(std::optional<double> mu = {}) {
  ModelOptions options = graded(paper_options(), 8, 1.3);
  options.soft.hardening_coefficient = 0.0;
  options.soft.temperature_coefficient = options.soft.pressure_coefficient = 0.0;
  options.soft.melting_temperature = 1e13;
  options.friction_coefficient = mu;
  return options;
}

struct Load {
  double dt, jump, pressure;
};
constexpr Load kLoads[] = {{1e-10, 100.0, 2e9}, {5e-9, 100.0, 2e9},  {1e-9, -100.0, 2e9}, {2e-8, -300.0, 2e9},
                           {1e-9, 40.0, 2e9},   {3e-9, 0.0, 2e9},    {1e-9, 80.0, 1e9},   {4e-9, 80.0, 0.7e9},
                           {1e-9, -80.0, 5e8},  {7e-9, -80.0, 3e9},  {2e-9, 10.0, -1.0},  {5e-10, 10.0, 1e9},
                           {1e-7, 10.0, 1e9},   {3e-9, -500.0, 1e9}, {3e-9, 500.0, 1e9},  {1e-9, 1e-3, 1e9}};

// The path of an ideally plastic layer under one load: the stress rises elastically at `rate` and stays within
// [-limit, limit], to which it relaxes at once. Returns the impulse and changes `s`.
double exact_impulse(double rate, double limit, double dt, double& s) {
  s = std::clamp(s, -limit, limit);
  const double left = rate == 0.0 ? dt : std::min(dt, (std::copysign(limit, rate) - s) / rate);
  const double end = s + rate * left;
  const double impulse = 0.5 * (s + end) * left + end * (dt - left);
  s = end;
  return impulse;
}

TEST(PhysicsMeanStress, IsExactForAnElasticLayerWithALimit) {
  for (const bool rubs : {false, true}) {
    const ModelOptions options = ideally_plastic(rubs ? std::optional(0.05) : std::nullopt);
    Rig rig(options, 1);
    rig.inputs.wants_mean_stress = true;
    const double G = options.soft.shear_modulus, h = options.grid.thickness;
    double s = 0.0;
    for (const Load& load : kLoads) {
      rig.set_all(load.jump, load.pressure);
      rig.step(load.dt);
      const double yield = options.soft.yield_strength / kSqrt3;
      const double limit = load.pressure <= 0.0 ? 0.0 : std::min(yield, rubs ? 0.05 * load.pressure : yield);
      const double impulse = exact_impulse(G * load.jump / h, limit, load.dt, s);
      EXPECT_NEAR(rig.outputs.mean_shear_stress[0] * load.dt, impulse, 1e-11 * limit * load.dt) << load.dt;
      EXPECT_NEAR(rig.stress(), s, 1e-11 * limit);
    }
  }
}

// Two components: a straight path is exact, and a path along one direction has the scalar mean along this direction.
TEST(PhysicsMeanStress, OfTwoComponentsIsThatOfThePath) {
  ModelOptions options = ideally_plastic();
  Rig one(options, 1);
  options.tangential_components = 2;
  Rig two(options, 1);
  one.inputs.wants_mean_stress = two.inputs.wants_mean_stress = true;
  const double c = 0.6, d = -0.8;
  for (const Load& load : kLoads) {
    one.set_all(load.jump, load.pressure);
    two.set_all(c * load.jump, load.pressure);
    two.inputs.second_velocity_jump[0] = d * load.jump;
    one.step(load.dt);
    two.step(load.dt);
    const double mean = one.outputs.mean_shear_stress[0];
    EXPECT_NEAR(two.outputs.mean_shear_stress[0], c * mean, 1e-6 + 1e-12 * std::abs(mean));
    EXPECT_NEAR(two.outputs.second_mean_shear_stress[0], d * mean, 1e-6 + 1e-12 * std::abs(mean));
  }
  Rig turned(options, 1);
  turned.inputs.wants_mean_stress = true;
  double before[2] = {};
  for (const double direction : {0.0, 1.0, 2.5, 4.0}) {  // an elastic path that turns
    turned.set_all(3.0 * std::cos(direction), 2e9);
    turned.inputs.second_velocity_jump[0] = 3.0 * std::sin(direction);
    turned.step(1e-9);
    EXPECT_EQ(turned.outputs.regime[0], Regime::kStick);
    const double after[2] = {turned.stress(), turned.second_stress()};
    EXPECT_NEAR(turned.outputs.mean_shear_stress[0], 0.5 * (before[0] + after[0]), 1e-6);
    EXPECT_NEAR(turned.outputs.second_mean_shear_stress[0], 0.5 * (before[1] + after[1]), 1e-6);
    std::copy_n(after, 2, before);
  }
}

// Force-driven: the answered stress is the constant one with which the momentum balance (61) gives the answered jump,
// so the mean is that stress, in the substeps of a tolerance, too.
TEST(PhysicsMeanStress, OfAForceDrivenStepIsTheAnsweredStress) {
  Draw draw(371);
  for (int scene = 0; scene < 60; ++scene) {
    ModelOptions options = random_options(draw, Strategy::kForceDriven, false);
    options.grid.cells = std::min(options.grid.cells, 12);
    const bool controlled = scene % 20 == 1;
    if (controlled) options = discretised(paper_options(Strategy::kForceDriven), 1e-2);
    if (scene % 4 == 0) {
      options.tangential_components = 2;
      if (!refusals(options).empty()) options.tangential_components = 1;
    }
    Rig rig(options);
    rig.inputs.wants_mean_stress = true;
    for (int step = 0; step < 20; ++step) {
      random_inputs(draw, rig, false);
      const double dt = controlled ? 1e-9 : random_dt(draw, false);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(rig.outputs.mean_shear_stress[l], rig.outputs.shear_stress[l]);
        if (options.tangential_components == 2) {
          ASSERT_EQ(rig.outputs.second_mean_shear_stress[l], rig.outputs.second_shear_stress[l]);
          continue;
        }
        const TileInputs& in = rig.inputs;
        const double far = dt * (in.stress_soft[l] / in.mass_soft[l] + in.stress_hard[l] / in.mass_hard[l]);
        const double drag = dt * rig.outputs.mean_shear_stress[l] * (1.0 / in.mass_soft[l] + 1.0 / in.mass_hard[l]);
        const double shear =
            options.plastic_layer ? kSqrt3 * options.grid.thickness * in.soft_plastic_strain_rate[l] : 0.0;
        const double size = std::abs(in.velocity_jump[l]) + std::abs(shear) + std::abs(far) + std::abs(drag);
        ASSERT_NEAR(rig.outputs.velocity_jump_new[l], in.velocity_jump[l] + far - drag, 1e-12 * size);
      }
    }
  }
}

// Whether the mean is asked for changes no bit of the states and the other answers, and an answer that nobody asked for
// is not written.
TEST(PhysicsMeanStress, ChangesNoOtherAnswer) {
  constexpr double kUnwritten = -12345.0;
  Draw draw(372);
  int asleep = 0, controlled = 0;
  for (int scene = 0; scene < 80; ++scene) {
    const Strategy strategy = scene % 2 == 0 ? Strategy::kVelocityDriven : Strategy::kForceDriven;
    ModelOptions options = random_options(draw, strategy, false);
    options.grid.cells = std::min(options.grid.cells, 12);
    options.sleep = scene % 3 == 0 && goes_with(Property::kSleep, options);
    if (scene % 20 >= 18) options = discretised(paper_options(strategy), 1e-2);
    if (goes_with(Property::kTwoComponents, options) && scene % 4 == 1) options.tangential_components = 2;
    if (!refusals(options).empty()) continue;
    Rig asked(options), silent(options);
    asked.inputs.wants_mean_stress = true;
    controlled += options.tolerance.has_value();
    for (int step = 0; step < 24; ++step) {
      if (step < 4) random_inputs(draw, asked, false);
      if (step == 4) asked.set_all(0.0, 1e9);
      const double dt = options.tolerance ? 1e-9 : random_dt(draw, false);
      silent.inputs = asked.inputs;
      silent.inputs.wants_mean_stress = false;
      std::fill_n(silent.outputs.mean_shear_stress, kLanes, kUnwritten);
      asked.step(dt);
      silent.step(dt);
      ASSERT_EQ(std::memcmp(asked.committed.data(), silent.committed.data(), sizeof(double) * asked.committed.size()),
                0)
          << "scene " << scene << ", step " << step;
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(asked.outputs.shear_stress[l], silent.outputs.shear_stress[l]);
        ASSERT_EQ(asked.outputs.sliding_velocity[l], silent.outputs.sliding_velocity[l]);
        ASSERT_EQ(asked.outputs.friction_heat[l], silent.outputs.friction_heat[l]);
        ASSERT_EQ(asked.outputs.outcome[l], silent.outputs.outcome[l]);
        ASSERT_EQ(silent.outputs.mean_shear_stress[l], kUnwritten);
        ASSERT_TRUE(std::isfinite(asked.outputs.mean_shear_stress[l]));
        if (asked.outputs.regime[l] == Regime::kOpen) {
          ASSERT_EQ(asked.outputs.mean_shear_stress[l], 0.0);
        }
        asleep += (asked.outputs.outcome[l] & kAsleep) != 0;
      }
    }
  }
  EXPECT_GT(asleep, 100);
  EXPECT_EQ(controlled, 8);
}

// A node that sleeps has the mean of its elastic path.
TEST(PhysicsMeanStress, OfASleepingNodeIsThatOfTheNodeAwake) {
  ModelOptions options = graded(paper_options(), 20, 1.2);
  Rig awake(options, 1);
  options.sleep = true;
  Rig sleeper(options, 1);
  int asleep = 0;
  for (int step = 0; step < 80; ++step) {
    for (Rig* rig : {&awake, &sleeper}) {
      rig->inputs.wants_mean_stress = true;
      rig->set_all(step < 3 ? 50.0 : step == 3 ? -50.0 : step % 7 == 0 ? -1e-3 : 0.0, 2e9);
      rig->step(1e-9);
    }
    EXPECT_NEAR(sleeper.outputs.mean_shear_stress[0], awake.outputs.mean_shear_stress[0], 1e-2) << step;
    asleep += (sleeper.outputs.outcome[0] & kAsleep) != 0;
  }
  EXPECT_GT(asleep, 20);
}

}  // namespace
}  // namespace shearbus::testing
