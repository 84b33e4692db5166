// What a scene's options become in the model, and which are refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::service {
namespace {

using ::testing::HasSubstr;

wire::Status refusal_of(const wire::Scene& scene) {
  try {
    scene_model(scene);
  } catch (const wire::Error& error) {
    return error.status();
  }
  return {};
}

TEST(SceneOptions, HardLayerIsAbsentUnlessAskedFor) {
  const SceneModel made = scene_model(support::velocity_scene());
  EXPECT_FALSE(made.options.hard_grid);
  EXPECT_FALSE(made.effective.hard_layer);
}

TEST(SceneOptions, AnEmptyHardLayerIsTheLayersScaledToTheHeatDepth) {
  wire::Scene scene = support::velocity_scene();
  scene.layer.far_boundary = wire::FarBoundary::kHalfSpace;
  scene.hard_layer.emplace();
  const SceneModel made = scene_model(scene);
  ASSERT_TRUE(made.options.hard_grid);
  EXPECT_DOUBLE_EQ(made.options.hard_grid->thickness, 20e-6 * std::sqrt(4.076e-6 / 48.9e-6));
  EXPECT_EQ(made.options.hard_grid->cells, 24);
  EXPECT_EQ(made.options.hard_grid->grading, 1.15);
  EXPECT_EQ(made.options.hard_grid->far_boundary, physics::FarBoundary::kHalfSpace);
  // The effective scene says it all, and says the same when it comes back.
  ASSERT_TRUE(made.effective.hard_layer);
  EXPECT_EQ(made.effective.hard_layer->thickness_m, made.options.hard_grid->thickness);
  EXPECT_EQ(scene_model(made.effective).options.hard_grid->thickness, made.options.hard_grid->thickness);
  EXPECT_EQ(wire::scene_to_toml(scene_model(made.effective).effective), wire::scene_to_toml(made.effective));
}

TEST(SceneOptions, HardLayerKeepsWhatIsGiven) {
  wire::Scene scene = support::force_scene();
  scene.hard_layer =
      wire::HardLayer{.thickness_m = 5e-6, .cells = 40, .grading = 1.0, .far_boundary = wire::FarBoundary::kHalfSpace};
  const physics::GridOptions hard = *scene_model(scene).options.hard_grid;
  EXPECT_EQ(hard.thickness, 5e-6);
  EXPECT_EQ(hard.cells, 40);
  EXPECT_EQ(hard.grading, 1.0);
  EXPECT_EQ(hard.far_boundary, physics::FarBoundary::kHalfSpace);
}

TEST(SceneOptions, AHardLayerWithoutAFirstCellIsRefused) {
  wire::Scene scene = support::velocity_scene();
  scene.hard_layer = wire::HardLayer{.thickness_m = 1e-6, .cells = 100000, .grading = {}};
  EXPECT_EQ(refusal_of(scene).field, "hard_layer.cells");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("hard_layer.grading = 1.15 with 100000 cells"));
  scene.hard_layer = wire::HardLayer{.thickness_m = 0.0};
  EXPECT_EQ(refusal_of(scene).field, "hard_layer.thickness_m");
}

TEST(SceneOptions, PlasticHeatingIsRefusedWhereItsWorkWouldCountTwiceOrHaveNoBody) {
  wire::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.taylor_quinney_factor);
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_EQ(refusal_of(scene).field, "velocity_driven.taylor_quinney_factor");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("needs the table [hard_layer]"));
  scene.hard_layer.emplace();
  EXPECT_EQ(scene_model(scene).options.taylor_quinney_factor, 0.9);
  scene.velocity_driven.drive = wire::Drive::kInterfaceSlip;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("count it twice"));
  scene.velocity_driven.taylor_quinney_factor = 1.5;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("above 0 and at most 1"));
  scene = support::force_scene();
  scene.hard_layer.emplace();
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("under strategy force_driven plastic work heats nothing"));
}

TEST(SceneOptions, SecondOrderAndModesAreRefusedWhereTheyWouldMeanNothing) {
  wire::Scene scene = support::force_scene();
  EXPECT_EQ(scene_model(scene).options.time_integrator, physics::TimeIntegrator::kBackwardEuler);
  EXPECT_FALSE(scene_model(scene).options.modes);
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  scene.layer.heat = wire::Heat::kModes;
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.time_integrator, physics::TimeIntegrator::kSdirk2);
  EXPECT_EQ(made.options.modes->accuracy, 1e-6);
  ASSERT_TRUE(made.effective.layer.modes);
  EXPECT_EQ(wire::scene_to_toml(scene_model(made.effective).effective), wire::scene_to_toml(made.effective));

  scene.hard_layer.emplace();
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("follows one body"));
  scene.hard_layer.reset();
  scene.layer.modes = wire::HeatModes{.shortest_step_s = 1e-6, .longest_time_s = 1e-7};
  EXPECT_EQ(refusal_of(scene).field, "layer.modes.longest_time_s");
  scene.layer.heat = wire::Heat::kProfile;
  EXPECT_EQ(refusal_of(scene).field, "layer.modes");
  scene.layer.modes.reset();
  scene.interface->plastic_layer = true;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("share one balance per step"));
  scene.layer.time_integrator = wire::TimeIntegrator::kBackwardEuler;
  EXPECT_EQ(refusal_of(scene).text, "");
  scene.layer.heat = wire::Heat::kModes;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("plastic_layer flows by it"));

  scene = support::velocity_scene();
  scene.layer.heat = wire::Heat::kModes;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("velocity_driven flows by it"));
  scene.layer.heat = wire::Heat::kProfile;
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  EXPECT_EQ(refusal_of(scene).text, "");
  scene.hard_layer.emplace();
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_EQ(refusal_of(scene).field, "layer.time_integrator");
}

TEST(SceneOptions, StrengthUnderPressureNeedsItsConstantsAndIsTheSoftBodys) {
  wire::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.soft.varies_with_compression());
  scene.soft.melting_curve = wire::MeltingCurve::kLindemann;
  scene.soft.pressure_term = wire::PressureTerm::kCompressed;
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.soft.melting_curve, physics::MeltingCurve::kLindemann);
  EXPECT_EQ(made.options.soft.pressure_term, physics::PressureTerm::kCompressed);
  EXPECT_EQ(scene_model(made.effective).options.soft.melting_curve, physics::MeltingCurve::kLindemann);

  // A body of its own constants, the compression's not among them.
  scene.soft.material.clear();
  for (const auto& [name, value] : made.effective.soft.given)
    if (name != "hugoniot_slope") scene.soft.given.emplace_back(name, value);
  EXPECT_EQ(refusal_of(scene).field, "soft.hugoniot_slope");
  scene.soft.melting_curve = wire::MeltingCurve::kConstant;
  scene.soft.pressure_term = wire::PressureTerm::kLinear;
  EXPECT_EQ(refusal_of(scene).text, "");

  scene.hard.melting_curve = wire::MeltingCurve::kLindemann;
  EXPECT_EQ(refusal_of(scene).field, "hard.melting_curve");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("only the soft body's is computed"));
}

}  // namespace
}  // namespace shearbus::service
