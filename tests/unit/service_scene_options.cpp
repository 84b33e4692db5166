// What a scene's options become in the model, and which are refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
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

TEST(SceneOptions, JunctionsAreOfTheSoftMetalUnlessGivenAndYieldAsTheInterface) {
  wire::Scene scene = support::force_scene();
  EXPECT_FALSE(scene_model(scene).options.junctions);
  scene.junctions = wire::Junctions{.contact_fraction = 0.3, .height_m = 1e-7};
  const SceneModel made = scene_model(scene);
  ASSERT_TRUE(made.options.junctions);
  const physics::JunctionOptions& junctions = *made.options.junctions;
  EXPECT_EQ(junctions.contact_fraction, 0.3);
  EXPECT_EQ(junctions.height, 1e-7);
  EXPECT_EQ(junctions.metal.yield_strength, scene.interface->yield_strength_pa);
  EXPECT_EQ(junctions.metal.yield_strength_max, made.options.soft.yield_strength_max);
  EXPECT_EQ(junctions.metal.hardening_coefficient, made.options.soft.hardening_coefficient);
  EXPECT_EQ(junctions.metal.hardening_exponent, made.options.soft.hardening_exponent);
  EXPECT_EQ(made.effective.junctions->hardening_exponent, made.options.soft.hardening_exponent);
  EXPECT_EQ(wire::scene_to_toml(scene_model(made.effective).effective), wire::scene_to_toml(made.effective));
  scene.junctions->yield_strength_max_pa = 5e8;
  scene.junctions->hardening_coefficient = 7.0;
  scene.junctions->hardening_exponent = 0.7;
  const physics::Material own = scene_model(scene).options.junctions->metal;
  EXPECT_EQ(own.yield_strength_max, 5e8);
  EXPECT_EQ(own.hardening_coefficient, 7.0);
  EXPECT_EQ(own.hardening_exponent, 0.7);
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
  scene.interface->plastic_layer = false;
  scene.layer.heat = wire::Heat::kProfile;
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  scene.tangential_components = 2;
  EXPECT_EQ(refusal_of(scene).text, "");
  scene.junctions.emplace();
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("is not made for [junctions]"));
  scene.junctions.reset();
  scene.interface->friction_law = wire::FrictionLaw::kVelocityWeakening;
  scene.interface->friction_coefficient_fast = 0.02;
  scene.interface->velocity_decay_s_per_m = 0.01;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("for the mean slip of a step"));
  scene.layer.time_integrator = wire::TimeIntegrator::kBackwardEuler;
  scene.layer.heat = wire::Heat::kModes;
  EXPECT_EQ(refusal_of(scene).text, "");

  scene = support::velocity_scene();
  scene.layer.heat = wire::Heat::kModes;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("velocity_driven flows by it"));
  scene.layer.heat = wire::Heat::kProfile;
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  EXPECT_EQ(refusal_of(scene).text, "");
  scene.layer.inertia = true;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("the waves are followed to first order"));
  scene.layer.inertia = false;
  scene.hard_layer.emplace();
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_EQ(refusal_of(scene).field, "layer.time_integrator");
}

TEST(SceneOptions, AToleranceChoosesGridAndMethodsAndIsRefusedBesideThem) {
  wire::Scene scene = support::velocity_scene();
  scene.layer = {.thickness_m = 20e-6};
  scene.tolerance = 1e-3;
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.tolerance, 1e-3);
  EXPECT_EQ(made.options.time_integrator, physics::TimeIntegrator::kSdirk2);
  EXPECT_GT(made.options.grid.cells, 20);
  EXPECT_LT(made.options.grid.cells, 200);
  scene.tolerance = 1e-2;
  EXPECT_LT(scene_model(scene).options.grid.cells, made.options.grid.cells);
  EXPECT_THAT(physics::Model(made.options).warnings(), ::testing::Contains(HasSubstr("tolerance 0.001: ")));
  // What a server answers opens the same session again, as a message and as a file.
  const std::string text = wire::scene_to_toml(made.effective);
  EXPECT_EQ(wire::scene_to_toml(scene_model(made.effective).effective), text);
  EXPECT_EQ(scene_model(wire::parse_scene(text, "effective").scene).options.grid.cells, made.options.grid.cells);

  scene.hard_layer.emplace();
  const SceneModel two_sided = scene_model(scene);
  EXPECT_EQ(two_sided.options.hard_grid->cells, two_sided.options.grid.cells);
  EXPECT_EQ(wire::scene_to_toml(scene_model(two_sided.effective).effective), wire::scene_to_toml(two_sided.effective));
  scene.hard_layer->cells = 60;
  EXPECT_EQ(refusal_of(scene).field, "hard_layer.cells");
  scene.hard_layer->cells.reset();
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("where the flow gathers in a band"));
  scene.velocity_driven.taylor_quinney_factor.reset();
  scene.layer.inertia = true;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("waves cross the layer unseen"));
  scene.layer.inertia = false;
  scene.layer.cells = 60;
  EXPECT_EQ(refusal_of(scene).field, "layer.cells");
  scene.layer.cells = 500;  // as if not given
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("is the server's choice"));
  scene.layer.time_integrator = wire::TimeIntegrator::kBackwardEuler;
  scene.tolerance = 0.5;
  EXPECT_EQ(refusal_of(scene).field, "tolerance");

  scene = support::force_scene();
  scene.layer = {};
  scene.tolerance = 1e-4;
  EXPECT_TRUE(scene_model(scene).options.modes);
  scene.interface->plastic_layer = true;
  EXPECT_FALSE(scene_model(scene).options.modes);
  EXPECT_EQ(scene_model(scene).options.time_integrator, physics::TimeIntegrator::kBackwardEuler);
}

TEST(SceneOptions, InertiaIsRefusedWhereItHasNoMeaning) {
  wire::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.inertia);
  scene.layer.inertia = true;
  EXPECT_TRUE(scene_model(scene).options.inertia);
  EXPECT_TRUE(scene_model(scene_model(scene).effective).options.inertia);
  scene.hard_layer.emplace();
  scene.layer.far_boundary = wire::FarBoundary::kHalfSpace;
  EXPECT_TRUE(scene_model(scene).options.inertia);
  scene.velocity_driven.taylor_quinney_factor = 0.9;
  EXPECT_EQ(refusal_of(scene).field, "layer.inertia");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("the stress varies across the layer"));
  scene.velocity_driven.taylor_quinney_factor.reset();
  scene.velocity_driven.drive = wire::Drive::kInterfaceSlip;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("needs drive = \"layer_shear\""));
  scene.velocity_driven.drive = wire::Drive::kLayerShear;
  scene.layer.grading = 1.0;
  scene.layer.cells = 1001;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("at most 1000 cells, found layer.cells = 1001"));
  scene = support::force_scene();
  scene.layer.inertia = true;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("would then count twice"));
}

TEST(SceneOptions, SleepIsRefusedWhereNothingCouldRest) {
  wire::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.sleep);
  scene.layer.sleep = true;
  EXPECT_TRUE(scene_model(scene_model(scene).effective).options.sleep);
  scene.layer.grading = 1.0;
  scene.layer.cells = 451;
  scene.hard_layer.emplace();
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("at most 900 cells of both bodies, found 902"));
  scene.hard_layer->cells = 449;
  scene.layer.far_boundary = wire::FarBoundary::kHalfSpace;
  const physics::Model most(scene_model(scene).options);  // half-spaces behind both: its modes must fit
  EXPECT_LE(most.layout().num_vertices + most.layout().num_hard_vertices, std::size_t{physics::kMaxBasisVertices});
  scene.layer.inertia = true;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("cannot be combined with layer.inertia"));
}

TEST(SceneOptions, TwoComponentsAreRefusedWhereSomethingHasNoDirection) {
  wire::Scene scene = support::velocity_scene();
  EXPECT_EQ(scene_model(scene).options.tangential_components, 1);
  scene.tangential_components = 2;
  EXPECT_EQ(scene_model(scene).options.tangential_components, 2);
  EXPECT_EQ(scene_model(scene_model(scene).effective).options.tangential_components, 2);
  scene.layer.inertia = true;
  EXPECT_EQ(refusal_of(scene).field, "tangential_components");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("cannot be combined with layer.inertia"));
  scene.layer.inertia = false;
  scene.velocity_driven.drive = wire::Drive::kInterfaceSlip;
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("has no direction"));
  scene = support::force_scene();
  scene.tangential_components = 2;
  EXPECT_EQ(scene_model(scene).options.tangential_components, 2);
  scene.tangential_components = 3;
  EXPECT_EQ(refusal_of(scene).field, "tangential_components");
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

const std::vector<std::pair<std::string, double>> kJohnsonCookCopper = {
    {"yield_strength_pa", 90e6},        {"hardening_modulus_pa", 292e6},      {"hardening_exponent", 0.31},
    {"rate_coefficient", 0.025},        {"reference_strain_rate_per_s", 1.0}, {"thermal_softening_exponent", 1.09},
    {"reference_temperature_k", 298.0},
};

TEST(SceneOptions, AFlowLawComesWithItsOwnConstantsAndComesBack) {
  wire::Scene scene = support::velocity_scene();
  scene.soft.flow_law = wire::FlowLaw::kJohnsonCook;
  EXPECT_EQ(refusal_of(scene).field, "soft.yield_strength_pa");  // the catalog's belongs to another law
  scene.soft.given = kJohnsonCookCopper;
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.soft.flow_law, physics::FlowLaws::place<physics::JohnsonCook>());
  EXPECT_EQ(made.options.soft.hardening_modulus, 292e6);
  const std::string text = wire::scene_to_toml(made.effective);
  EXPECT_THAT(text, HasSubstr("flow_law = \"johnson_cook\""));
  EXPECT_THAT(text.substr(0, text.find("[hard]")), ::testing::Not(HasSubstr("hardening_coefficient")));
  const SceneModel again = scene_model(wire::parse_scene(text, "effective").scene);
  EXPECT_EQ(wire::scene_to_toml(again.effective), text);

  scene.soft.pressure_term = wire::PressureTerm::kCompressed;
  EXPECT_EQ(refusal_of(scene).field, "soft.pressure_term");
  scene.soft.pressure_term = wire::PressureTerm::kLinear;
  scene.soft.melting_curve = wire::MeltingCurve::kLindemann;
  EXPECT_EQ(refusal_of(scene).text, "");
  scene.layer.time_integrator = wire::TimeIntegrator::kSdirk2;
  EXPECT_EQ(refusal_of(scene).field, "layer.time_integrator");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("follows the rate of a step"));
  scene.layer.time_integrator = wire::TimeIntegrator::kBackwardEuler;
}

TEST(SceneOptions, AFrictionLawComesWithItsOwnConstantsAndComesBack) {
  wire::Scene scene = support::force_scene();
  EXPECT_EQ(scene_model(scene).options.interface.friction_law, physics::FrictionLaw{});
  scene.interface->friction_law = wire::FrictionLaw::kVelocityWeakening;
  scene.interface->friction_coefficient_fast = 0.02;
  scene.interface->velocity_decay_s_per_m = 0.01;
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.interface.friction_law, physics::FrictionLaws::place<physics::VelocityWeakening>());
  EXPECT_EQ(made.options.interface.friction_coefficient_fast, 0.02);
  EXPECT_EQ(made.options.interface.velocity_decay, 0.01);
  scene.interface->plastic_layer = true;
  EXPECT_EQ(refusal_of(scene).field, "interface.friction_law");
  const std::string text = wire::scene_to_toml(made.effective);
  EXPECT_THAT(text, HasSubstr("friction_law = \"velocity_weakening\""));
  EXPECT_EQ(wire::scene_to_toml(scene_model(wire::parse_scene(text, "effective").scene).effective), text);
}

// The scene's choices are the registered laws, in their order.
TEST(SceneOptions, EveryRegisteredLawHasItsWord) {
  const std::string reference = wire::scene_reference();
  std::string flow, friction;
  for (int n = 1; const auto law = physics::FlowLaws::numbered(n); ++n)
    flow.append(n > 1 ? " or " : "").append("\"").append(physics::FlowLaws::name_of(*law)).append("\"");
  for (int n = 1; const auto law = physics::FrictionLaws::numbered(n); ++n)
    friction.append(n > 1 ? " or " : "").append("\"").append(physics::FrictionLaws::name_of(*law)).append("\"");
  EXPECT_THAT(reference, HasSubstr("| `flow_law` | " + flow + " |"));
  EXPECT_THAT(reference, HasSubstr("| `friction_law` | " + friction + " |"));
}

}  // namespace
}  // namespace shearbus::service
