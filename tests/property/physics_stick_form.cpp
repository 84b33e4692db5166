// A request in stick form (stick stress and impedance) has the answer of the same request in far-field form (stresses
// and masses of both half zones), to rounding, whatever the options of the scene.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "server/service/columns.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

using wire::Field;

double impedance_of(const TileInputs& in, double dt, int lane) {
  return 1.0 / (dt * (1.0 / in.mass_soft[lane] + 1.0 / in.mass_hard[lane]));
}

// Converts the inputs of `far_field` to a request in stick form, lets the service read this request, and sets the
// inputs of `stick` to the result.
void convert(const Rig& far_field, double dt, Rig& stick) {
  const TileInputs& in = far_field.inputs;
  const auto components = static_cast<std::uint32_t>(far_field.model.options().tangential_components);
  wire::Batch request = wire::Batch::of(
      std::array{Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance}, kLanes, components);
  for (int l = 0; l < kLanes; ++l) {
    const auto row = static_cast<std::size_t>(l);
    const double Z = impedance_of(in, dt, l);
    const auto stick_stress = [&](double jump, double soft, double hard) {
      return Z * (jump + dt * (soft / in.mass_soft[l] + hard / in.mass_hard[l]));
    };
    request.f64(Field::kVelocityJump)[row] = in.velocity_jump[l];
    request.f64(Field::kPressure)[row] = in.pressure[l];
    request.f64(Field::kImpedance)[row] = Z;
    request.f64(Field::kStickStress)[row] = stick_stress(in.velocity_jump[l], in.stress_soft[l], in.stress_hard[l]);
    if (components == 1) continue;
    request.f64(Field::kVelocityJump, 1)[row] = in.second_velocity_jump[l];
    request.f64(Field::kStickStress, 1)[row] =
        stick_stress(in.second_velocity_jump[l], in.second_stress_soft[l], in.second_stress_hard[l]);
  }
  wire::Batch no_reply;
  const shard::StepColumns columns = service::step_columns(request, no_reply, dt);
  stick.inputs = {};
  stick.inputs.active = in.active;
  std::copy_n(in.soft_plastic_strain_rate, kLanes, stick.inputs.soft_plastic_strain_rate);
  std::copy_n(in.second_soft_plastic_strain_rate, kLanes, stick.inputs.second_soft_plastic_strain_rate);
  for (const shard::InputColumn& column : columns.inputs) std::ranges::copy(column.values, stick.inputs.*column.member);
}

// The number of tangential components, and whether the scenes have a tolerance.
using Case = std::pair<int, bool>;
class PhysicsStickForm : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsStickForm, HasTheAnswerOfTheFarFieldForm) {
  const auto [components, with_tolerance] = GetParam();
  Draw draw(71);
  int compared = 0, divided = 0, sticking = 0, sliding = 0, open = 0, flowing = 0;
  double worst = 0.0;
  for (int scene = 0; scene < (with_tolerance ? 6 : 60); ++scene) {
    ModelOptions options = components == 2 ? random_two_component_options(draw, Strategy::kForceDriven, false)
                                           : random_options(draw, Strategy::kForceDriven, false);
    if (with_tolerance) options.tolerance = 1e-3;
    Rig far_field(options), stick(options);
    for (int n = 0; n < (with_tolerance ? 6 : 15); ++n) {
      components == 2 ? random_vectors(draw, far_field, false) : random_inputs(draw, far_field, false);
      const double dt = std::max(random_dt(draw, false), shortest_step(options));
      convert(far_field, dt, stick);
      // Each step starts from the same state, because near melting the rounding errors grow from step to step.
      stick.committed = far_field.committed;
      far_field.step(dt);
      stick.step(dt);
      const TileInputs& in = far_field.inputs;
      const TileOutputs &want = far_field.outputs, &found = stick.outputs;
      for (int l = 0; l < kLanes; ++l) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l) +
                     ", " + std::string(FrictionLaws::name_of(options.interface.friction_law)));
        if (((want.outcome[l] | found.outcome[l]) & (kSubstepped | kMultipleRoots)) != 0) {
          ++divided;  // the step may have several answers, and a rounding error decides which is found
          continue;
        }
        const double Z = impedance_of(in, dt, l);
        const double speed = std::hypot(in.velocity_jump[l], in.second_velocity_jump[l]) +
                             dt * (std::hypot(in.stress_soft[l], in.second_stress_soft[l]) / in.mass_soft[l] +
                                   std::hypot(in.stress_hard[l], in.second_stress_hard[l]) / in.mass_hard[l]) +
                             kSqrt3 * options.grid.thickness *
                                 std::hypot(in.soft_plastic_strain_rate[l], in.second_soft_plastic_strain_rate[l]) +
                             1e-6;
        const double stress = std::hypot(want.shear_stress[l], want.second_shear_stress[l]);
        const double T0 = want.interface_temperature[l];
        const double to_melting =
            std::max(1e-6, std::abs(at_pressure(options.soft, in.pressure[l]).melting_temperature - T0));
        // Near melting the strength, and with it the stress, is sensitive to the last bits of the temperature.
        const double eps = 1e-10 + 1e-12 * T0 / (to_melting * to_melting) / flow_exponent(options.soft);
        const auto expect_equal = [&](double a, double b, double size) {
          ASSERT_NEAR(a, b, eps * size);
          worst = std::max(worst, std::abs(a - b) / size);
        };
        ASSERT_EQ(found.outcome[l], want.outcome[l]);
        ASSERT_NEAR(found.interface_temperature[l], T0, 1e-8);
        expect_equal(found.shear_stress[l], want.shear_stress[l], stress + Z * speed);
        expect_equal(found.velocity_jump_new[l], want.velocity_jump_new[l], speed);
        expect_equal(found.sliding_velocity[l], want.sliding_velocity[l], 1e2 * speed);
        if (components == 2) {
          expect_equal(found.second_shear_stress[l], want.second_shear_stress[l], stress + Z * speed);
          expect_equal(found.second_velocity_jump_new[l], want.second_velocity_jump_new[l], speed);
          expect_equal(found.second_sliding_velocity[l], want.second_sliding_velocity[l], 1e2 * speed);
        }
        if (::testing::Test::HasFatalFailure()) return;
        ++compared;
        open += want.regime[l] == Regime::kOpen;
        sticking += want.regime[l] == Regime::kStick;
        sliding += want.regime[l] > Regime::kStick;
        flowing += options.plastic_layer && want.regime[l] != Regime::kOpen;
      }
    }
  }
  std::printf("%d node-steps (open %d, stick %d, sliding %d; %d on a plastic layer; %d divided): at most %.1e apart\n",
              compared, open, sticking, sliding, flowing, divided, worst);
  EXPECT_GT(std::min({open, sticking, sliding, flowing}), 10);
}

INSTANTIATE_TEST_SUITE_P(Scenes, PhysicsStickForm, ::testing::Values(Case{1, false}, Case{2, false}, Case{1, true}),
                         [](const ::testing::TestParamInfo<Case>& scenes) {
                           return std::string(scenes.param.first == 2 ? "TwoComponents" : "OneComponent") +
                                  (scenes.param.second ? "WithTolerance" : "");
                         });

}  // namespace
}  // namespace shearbus::testing
