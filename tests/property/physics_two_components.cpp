// Slip with two tangential components is isotropic: a rotated problem has the rotated answer, and a problem with slip
// along an axis has the answer of the scalar problem.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "tests/support/random_physics.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::testing {
namespace {

void copy_turned(const Rig& from, double angle, Rig& to) {
  to.inputs = from.inputs;
  const double c = std::cos(angle), s = std::sin(angle);
  const auto turn = [&](const double* x, const double* y, double* x_turned, double* y_turned) {
    for (int l = 0; l < kLanes; ++l) {
      x_turned[l] = c * x[l] - s * y[l];
      y_turned[l] = s * x[l] + c * y[l];
    }
  };
  turn(from.inputs.velocity_jump, from.inputs.second_velocity_jump, to.inputs.velocity_jump,
       to.inputs.second_velocity_jump);
  turn(from.inputs.stress_soft, from.inputs.second_stress_soft, to.inputs.stress_soft, to.inputs.second_stress_soft);
  turn(from.inputs.stress_hard, from.inputs.second_stress_hard, to.inputs.stress_hard, to.inputs.second_stress_hard);
  turn(from.inputs.soft_plastic_strain_rate, from.inputs.second_soft_plastic_strain_rate,
       to.inputs.soft_plastic_strain_rate, to.inputs.second_soft_plastic_strain_rate);
  // Each step of the rotated problem starts from the rotated state of the original problem: near melting rounding
  // errors would grow from step to step.
  to.committed = from.committed;
  const TileLayout& layout = from.model.layout();
  turn(from.committed.data() + layout.shear_stress, from.committed.data() + layout.second_stress,
       to.committed.data() + layout.shear_stress, to.committed.data() + layout.second_stress);
}

// Returns the hardening exponent n of a flow law that has one, otherwise the law's `flow_exponent`.
double exponent_of(const Material& m) {
  return has_constant(m.flow_law, &Material::hardening_exponent) ? m.hardening_exponent : flow_exponent(m);
}

class PhysicsTwoComponents : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsTwoComponents, ATurnedProblemHasTheTurnedAnswer) {
  Draw draw(61);
  int compared = 0, sliding = 0, sticking = 0, open = 0;
  double worst = 0.0;
  for (int scene = 0; scene < 60; ++scene) {
    const ModelOptions options = random_two_component_options(draw, GetParam(), false);
    Rig rig(options), turned(options);
    for (int n = 0; n < 15; ++n) {
      random_vectors(draw, rig, false);
      const double angle = draw.uniform(-M_PI, M_PI);
      copy_turned(rig, angle, turned);
      const double dt = random_dt(draw, false);
      double stress_before[kLanes];
      for (int l = 0; l < kLanes; ++l) stress_before[l] = std::hypot(rig.stress(l), rig.second_stress(l));
      rig.step(dt);
      turned.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        if ((rig.outputs.outcome[l] | turned.outputs.outcome[l]) & kSubstepped)
          continue;  // a divided step may have several answers, of which rounding chooses one
        const double T0 = rig.outputs.interface_temperature[l];
        const double to_melting =
            std::max(1e-6, std::abs(at_pressure(options.soft, rig.inputs.pressure[l]).melting_temperature - T0));
        const double eps = 1e-10 + 1e-12 * T0 / (to_melting * to_melting) / exponent_of(options.soft);
        ASSERT_NEAR(turned.outputs.interface_temperature[l], T0, 1e-9);
        if (std::hypot(rig.outputs.sliding_velocity[l], rig.outputs.second_sliding_velocity[l]) > 1e-6) {
          ASSERT_EQ(turned.outputs.regime[l], rig.outputs.regime[l]);
        }
        const double c = std::cos(angle), s = std::sin(angle);
        const auto expect_turned = [&](double x, double y, double x_turned, double y_turned, double size) {
          ASSERT_NEAR(x_turned, c * x - s * y, eps * size);
          ASSERT_NEAR(y_turned, s * x + c * y, eps * size);
          worst = std::max(worst, std::abs(x_turned - (c * x - s * y)) / size);
        };
        const double stress = std::hypot(rig.outputs.shear_stress[l], rig.outputs.second_shear_stress[l]);
        expect_turned(rig.outputs.shear_stress[l], rig.outputs.second_shear_stress[l], turned.outputs.shear_stress[l],
                      turned.outputs.second_shear_stress[l], stress + 1.0);
        const double free_jump =
            std::hypot(rig.inputs.velocity_jump[l], rig.inputs.second_velocity_jump[l]) +
            dt * (std::abs(rig.inputs.stress_soft[l]) + std::abs(rig.inputs.second_stress_soft[l])) /
                rig.inputs.mass_soft[l] +
            dt * (std::abs(rig.inputs.stress_hard[l]) + std::abs(rig.inputs.second_stress_hard[l])) /
                rig.inputs.mass_hard[l];
        const double speed = (GetParam() == Strategy::kForceDriven ? free_jump : 0.0) +
                             std::hypot(rig.inputs.velocity_jump[l], rig.inputs.second_velocity_jump[l]) +
                             options.grid.thickness * (stress + stress_before[l]) / (options.soft.shear_modulus * dt) +
                             1e-6;
        expect_turned(rig.outputs.velocity_jump_new[l], rig.outputs.second_velocity_jump_new[l],
                      turned.outputs.velocity_jump_new[l], turned.outputs.second_velocity_jump_new[l], speed);
        expect_turned(rig.outputs.sliding_velocity[l], rig.outputs.second_sliding_velocity[l],
                      turned.outputs.sliding_velocity[l], turned.outputs.second_sliding_velocity[l], 1e2 * speed);
        if (::testing::Test::HasFatalFailure()) return;
        ++compared;
        open += rig.outputs.regime[l] == Regime::kOpen;
        sticking += rig.outputs.regime[l] == Regime::kStick;
        sliding += rig.outputs.regime[l] > Regime::kStick;
      }
    }
  }
  std::printf("%d node-steps (open %d, stick %d, sliding %d): turned answers at most %.1e apart\n", compared, open,
              sticking, sliding, worst);
  EXPECT_GT(std::min({open, sticking, sliding}), 100);
}

TEST_P(PhysicsTwoComponents, AlongAnAxisItIsTheScalarProblemToTheBit) {
  Draw draw(62);
  for (int scene = 0; scene < 40; ++scene) {
    const bool extreme = scene % 2 == 1;
    ModelOptions plane = random_two_component_options(draw, GetParam(), extreme);
    if (scene % 4 == 2) {
      plane.taylor_quinney_factor.reset();
      // With a flow law that couples rate and temperature a step under a tolerance would take up to a second.
      if (properties_of(plane.soft.flow_law).separable) plane.tolerance = 1e-3;
    }
    ModelOptions line = plane;
    line.tangential_components = 1;
    Rig scalar(line);
    Rig first(plane), second(plane);
    for (int n = 0; n < 15; ++n) {
      random_inputs(draw, scalar, extreme);
      first.inputs = second.inputs = scalar.inputs;
      for (int l = 0; l < kLanes; ++l) {
        std::swap(second.inputs.velocity_jump[l], second.inputs.second_velocity_jump[l] = 0.0);
        std::swap(second.inputs.stress_soft[l], second.inputs.second_stress_soft[l] = 0.0);
        std::swap(second.inputs.stress_hard[l], second.inputs.second_stress_hard[l] = 0.0);
        std::swap(second.inputs.soft_plastic_strain_rate[l], second.inputs.second_soft_plastic_strain_rate[l] = 0.0);
      }
      const double dt = random_dt(draw, extreme);
      scalar.step(dt);
      first.step(dt);
      second.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        const TileOutputs& want = scalar.outputs;
        ASSERT_EQ(first.outputs.shear_stress[l], want.shear_stress[l]);
        // With a tolerance, the slip of an open contact is a mean over substeps. The models with one and with two
        // components round this mean differently.
        const bool rounded = plane.tolerance && want.regime[l] == Regime::kOpen;
        const double ulps = rounded ? 1e-14 * std::abs(want.sliding_velocity[l]) : 0.0;
        ASSERT_NEAR(first.outputs.sliding_velocity[l], want.sliding_velocity[l], ulps);
        ASSERT_EQ(first.outputs.velocity_jump_new[l], want.velocity_jump_new[l]);
        ASSERT_EQ(first.outputs.second_shear_stress[l], 0.0);
        ASSERT_EQ(second.outputs.second_shear_stress[l], want.shear_stress[l]);
        ASSERT_NEAR(second.outputs.second_sliding_velocity[l], want.sliding_velocity[l], ulps);
        ASSERT_EQ(second.outputs.second_velocity_jump_new[l], want.velocity_jump_new[l]);
        ASSERT_EQ(second.outputs.shear_stress[l], 0.0);
        for (const Rig* rig : {&first, &second}) {
          ASSERT_EQ(rig->outputs.interface_temperature[l], want.interface_temperature[l]);
          ASSERT_EQ(rig->outputs.friction_heat[l], want.friction_heat[l]);
          ASSERT_EQ(rig->outputs.regime[l], want.regime[l]);
          ASSERT_EQ(rig->outputs.outcome[l], want.outcome[l]);
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, PhysicsTwoComponents, support::both<Strategy>(), support::name_of_strategy);

// With two components a step is the scalar step along the trial vector: the elastic stress (velocity-driven) or the
// jump without friction (force-driven). The test itself projects the inputs for the scalar reference on this vector.
TEST(PhysicsTwoComponentsReference, TheStepIsTheTwinsAlongTheTrialStress) {
  Draw draw(63);
  int compared = 0;
  for (Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    for (int scene = 0; scene < 15; ++scene) {
      ModelOptions options = random_two_component_options(draw, strategy, false);
      options.grid.cells = draw.integer(1, 12);
      if (options.soft.hardening_coefficient == 0.0) options.soft.hardening_coefficient = 125.0;
      Rig rig(options);
      for (int n = 0; n < 8; ++n) {
        random_vectors(draw, rig, false);
        const double dt = random_dt(draw, false);
        const int l = n;
        const TileInputs& in = rig.inputs;
        const double stiffness = options.soft.shear_modulus * dt / options.grid.thickness;
        double x = rig.stress(l) + stiffness * in.velocity_jump[l];
        double y = rig.second_stress(l) + stiffness * rig.inputs.second_velocity_jump[l];
        if (strategy == Strategy::kForceDriven) {
          const double per_rate = options.plastic_layer ? kSqrt3 * options.grid.thickness : 0.0;
          x = in.velocity_jump[l] + per_rate * in.soft_plastic_strain_rate[l] +
              dt * (in.stress_soft[l] / in.mass_soft[l] + in.stress_hard[l] / in.mass_hard[l]);
          y = in.second_velocity_jump[l] + per_rate * in.second_soft_plastic_strain_rate[l] +
              dt * (in.second_stress_soft[l] / in.mass_soft[l] + in.second_stress_hard[l] / in.mass_hard[l]);
        }
        const double angle = std::atan2(y, x), c = std::cos(angle), s = std::sin(angle);
        reference::NodeState state = rig.node_state(l);
        state.shear_stress = c * rig.stress(l) + s * rig.second_stress(l);
        reference::NodeInputs inputs = rig.node_inputs(l);
        inputs.velocity_jump = c * in.velocity_jump[l] + s * rig.inputs.second_velocity_jump[l];
        inputs.stress_soft = c * in.stress_soft[l] + s * rig.inputs.second_stress_soft[l];
        inputs.stress_hard = c * in.stress_hard[l] + s * rig.inputs.second_stress_hard[l];
        inputs.soft_plastic_strain_rate =
            c * in.soft_plastic_strain_rate[l] + s * in.second_soft_plastic_strain_rate[l];
        const reference::NodeOutputs twin = reference::advance_one(options, dt, inputs, state);
        rig.step(dt);
        if ((rig.outputs.outcome[l] & kSubstepped) || twin.answers != 1 || x * x + y * y == 0.0) continue;
        const double T_melt = at_pressure(options.soft, in.pressure[l]).melting_temperature;
        const double to_melting = std::max(1e-6, std::abs(T_melt - twin.interface_temperature));
        const double eps = 1e-9 + 1e-11 * T_melt / (to_melting * to_melting) / exponent_of(options.soft);
        const double size = std::abs(twin.shear_stress);
        ASSERT_NEAR(rig.outputs.shear_stress[l], c * twin.shear_stress, eps * size + 1e-3) << scene << " " << n;
        ASSERT_NEAR(rig.outputs.second_shear_stress[l], s * twin.shear_stress, eps * size + 1e-3) << scene << " " << n;
        ASSERT_NEAR(rig.outputs.interface_temperature[l], twin.interface_temperature, 1e-7);
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 150);
}

// The interface sees the jump and the plastic shear of the host's zone as one vector, and the stress lies along it.
TEST(PhysicsTwoComponentsPath, TheHostsPlasticShearHasADirectionOfItsOwn) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven));
  options.plastic_layer = true;
  options.tangential_components = 2;
  Rig rig(options);
  rig.set_all(3.0, 11.2e9);
  const double across = 4.0 / (kSqrt3 * options.grid.thickness);
  std::fill_n(rig.inputs.second_soft_plastic_strain_rate, kLanes, across);
  rig.step(1e-9);
  const double s = std::hypot(rig.outputs.shear_stress[0], rig.outputs.second_shear_stress[0]);
  ASSERT_GT(s, 1e6);
  EXPECT_NEAR(rig.outputs.shear_stress[0] / s, 0.6, 1e-12);
  EXPECT_NEAR(rig.outputs.second_shear_stress[0] / s, 0.8, 1e-12);
  const double per_stress = 1e-9 * (1.0 / rig.inputs.mass_soft[0] + 1.0 / rig.inputs.mass_hard[0]);
  EXPECT_NEAR(rig.outputs.velocity_jump_new[0], 3.0 - 0.6 * s * per_stress, 1e-12);
  EXPECT_NEAR(rig.outputs.second_velocity_jump_new[0], -0.8 * s * per_stress, 1e-12) << "the momentum balance (61)";
}

// The energy ledger of a rotated problem must equal that of the scalar problem.
TEST(PhysicsLedgerOfTwoComponents, KnowsNoDirection) {
  Draw draw(77);
  for (int scene = 0; scene < 60; ++scene) {
    const Strategy strategy = scene % 2 == 0 ? Strategy::kVelocityDriven : Strategy::kForceDriven;
    ModelOptions options = random_options(draw, strategy, false);
    options.drive = Drive::kLayerShear;
    Rig scalar(options);
    options.tangential_components = 2;
    Rig plane(options);
    const double c = 0.6, s = 0.8;
    for (int step = 0; step < 10; ++step) {
      random_inputs(draw, scalar, false);
      plane.inputs = scalar.inputs;
      for (int l = 0; l < kLanes; ++l) {
        plane.inputs.second_velocity_jump[l] = s * scalar.inputs.velocity_jump[l];
        plane.inputs.second_stress_soft[l] = s * scalar.inputs.stress_soft[l];
        plane.inputs.second_stress_hard[l] = s * scalar.inputs.stress_hard[l];
        plane.inputs.second_soft_plastic_strain_rate[l] = s * scalar.inputs.soft_plastic_strain_rate[l];
        plane.inputs.velocity_jump[l] *= c;
        plane.inputs.stress_soft[l] *= c;
        plane.inputs.stress_hard[l] *= c;
        plane.inputs.soft_plastic_strain_rate[l] *= c;
      }
      const double dt = random_dt(draw, false);
      scalar.step(dt);
      plane.step(dt);
      TileLedger one, two;
      scalar.model.record_energy(*scalar.operators, scalar.inputs, scalar.outputs, scalar.trial.data(),
                                 scalar.committed.data(), one);
      plane.model.record_energy(*plane.operators, plane.inputs, plane.outputs, plane.trial.data(),
                                plane.committed.data(), two);
      for (int l = 0; l < kLanes; ++l) {
        // Rounding errors of the rotation grow near melting and from step to step, so the test skips lanes whose
        // stresses differ by more than 1e-9 of the stress.
        const double apart = std::abs(std::hypot(plane.outputs.shear_stress[l], plane.outputs.second_shear_stress[l]) -
                                      std::abs(scalar.outputs.shear_stress[l]));
        if (!(apart <= 1e-9 * std::abs(scalar.outputs.shear_stress[l]))) continue;
        const double stress = scalar.outputs.shear_stress[l];
        double size = 0.5 * options.grid.thickness * stress * stress / options.soft.shear_modulus;
        for (const auto& term : one.term) size += std::abs(term[l]);
        for (std::size_t i = 0; i < kLedgerTerms; ++i) {
          ASSERT_NEAR(two.term[i][l], one.term[i][l], 1e-6 * size) << scene << " " << step << " term " << i;
        }
      }
    }
  }
}

}  // namespace
}  // namespace shearbus::testing
