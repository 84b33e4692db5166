// Tests the conversion of a scene's options into options of the model, and the refusals of options.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/hydro.pb.h"
#include "proto/scene/rules.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/changed_scene.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::service {
namespace {

using support::with;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

wire::Status refusal_of(const v1::Scene& scene) {
  return support::fault_of([&] { scene_model(scene); });
}

struct Row {
  std::string changes;  // of a scene, as support::with() takes them
  const char* field;    // of its refusal; empty: it is accepted
  const char* text;     // a part of the refusal's text
};

void expect_refusals(const v1::Scene& scene, std::initializer_list<Row> rows) {
  for (const Row& row : rows) {
    SCOPED_TRACE(row.changes);
    const wire::Status found = refusal_of(with(scene, row.changes));
    EXPECT_EQ(found.field, row.field);
    EXPECT_THAT(found.text, HasSubstr(row.text));
    EXPECT_EQ(found.text.empty(), *row.field == '\0') << found.text;
  }
}

const std::string kSecondOrder = "time_integrator: TIME_INTEGRATOR_SDIRK2 ";
const std::string kWeakening =
    "interface { friction_law: FRICTION_LAW_VELOCITY_WEAKENING friction_coefficient_fast: 0.02 "
    "velocity_decay_s_per_m: 0.01 } ";

v1::Scene effective_of(const SceneModel& made) {
  return scene::parse(made.effective, "effective").scene;
}

// The effective scene that a server returns must have itself as its effective scene when it is sent back.
void expect_own(const SceneModel& made) {
  EXPECT_EQ(scene_model(made.effective, "effective").effective, made.effective);
}

TEST(SceneOptions, HardLayerIsAbsentUnlessAskedFor) {
  const SceneModel made = scene_model(support::velocity_scene());
  EXPECT_FALSE(made.options.hard_grid);
  EXPECT_FALSE(effective_of(made).has_hard_layer());
}

TEST(SceneOptions, AnEmptyHardLayerIsTheLayersScaledToTheHeatDepth) {
  const SceneModel made =
      scene_model(with(support::velocity_scene(), "layer { far_boundary: FAR_BOUNDARY_HALF_SPACE } hard_layer {}"));
  ASSERT_TRUE(made.options.hard_grid);
  EXPECT_DOUBLE_EQ(made.options.hard_grid->thickness, 20e-6 * std::sqrt(4.076e-6 / 48.9e-6));
  EXPECT_EQ(made.options.hard_grid->cells, 24);
  EXPECT_EQ(made.options.hard_grid->grading, 1.15);
  EXPECT_EQ(made.options.hard_grid->far_boundary, physics::FarBoundary::kHalfSpace);
  // The effective scene contains the whole grid of the hard layer, and gives the same grid when it is sent back.
  ASSERT_TRUE(effective_of(made).has_hard_layer());
  EXPECT_EQ(effective_of(made).hard_layer().thickness_m(), made.options.hard_grid->thickness);
  EXPECT_EQ(scene_model(made.effective, "effective").options.hard_grid->thickness, made.options.hard_grid->thickness);
  expect_own(made);
}

TEST(SceneOptions, HardLayerKeepsWhatIsGiven) {
  const std::string given =
      "hard_layer { thickness_m: 5e-6 cells: 40 grading: 1 far_boundary: FAR_BOUNDARY_HALF_SPACE }";
  const physics::GridOptions hard = *scene_model(with(support::force_scene(), given)).options.hard_grid;
  EXPECT_EQ(hard.thickness, 5e-6);
  EXPECT_EQ(hard.cells, 40);
  EXPECT_EQ(hard.grading, 1.0);
  EXPECT_EQ(hard.far_boundary, physics::FarBoundary::kHalfSpace);
}

TEST(SceneOptions, AHardLayerWithoutAFirstCellIsRefused) {
  expect_refusals(support::velocity_scene(), {{"hard_layer { thickness_m: 1e-6 cells: 100000 }", "hard_layer.cells",
                                               "hard_layer.cells = 100000 and hard_layer.grading = 1.15"},
                                              {"hard_layer { thickness_m: 0 }", "hard_layer.thickness_m", ""}});
}

TEST(SceneOptions, CellsNarrowerThanAnAtomAreRefused) {
  expect_refusals(
      support::velocity_scene(),
      {{"layer { thickness_m: 25e-9 cells: 100 grading: 1 }", "", ""},
       {"layer { thickness_m: 25e-9 cells: 101 grading: 1 }", "layer.cells",
        "make the first cell 2.48e-10 m wide, expected at least 2.5e-10 m"},
       {"layer { cells: 60 }", "", ""},
       {"layer { cells: 60 grading: 1.2 }", "layer.grading", ""},  // 7e-11 m
       {"layer { cells: 60 grading: 1 } hard_layer { thickness_m: 2e-9 cells: 10 }", "hard_layer.cells", ""}});
}

TEST(SceneOptions, JunctionsAreOfTheSoftMetalUnlessGivenAndYieldAsTheInterface) {
  v1::Scene scene = support::force_scene();
  EXPECT_FALSE(scene_model(scene).options.junctions);
  scene = with(scene, "junctions { contact_fraction: 0.3 height_m: 1e-7 }");
  const SceneModel made = scene_model(scene);
  ASSERT_TRUE(made.options.junctions);
  const physics::JunctionOptions& junctions = *made.options.junctions;
  EXPECT_EQ(junctions.contact_fraction, 0.3);
  EXPECT_EQ(junctions.height, 1e-7);
  EXPECT_EQ(junctions.metal.yield_strength, scene.interface().yield_strength_pa());
  EXPECT_EQ(junctions.metal.yield_strength_max, made.options.soft.yield_strength_max);
  EXPECT_EQ(junctions.metal.hardening_coefficient, made.options.soft.hardening_coefficient);
  EXPECT_EQ(junctions.metal.hardening_exponent, made.options.soft.hardening_exponent);
  EXPECT_EQ(effective_of(made).junctions().hardening_exponent(), made.options.soft.hardening_exponent);
  expect_own(made);
  const std::string given = "junctions { yield_strength_max_pa: 5e8 hardening_coefficient: 7 hardening_exponent: 0.7 }";
  const physics::Material own = scene_model(with(scene, given)).options.junctions->metal;
  EXPECT_EQ(own.yield_strength_max, 5e8);
  EXPECT_EQ(own.hardening_coefficient, 7.0);
  EXPECT_EQ(own.hardening_exponent, 0.7);
}

TEST(SceneOptions, PlasticHeatingIsRefusedWhereItsWorkWouldCountTwiceOrHaveNoBody) {
  const v1::Scene velocity = support::velocity_scene(), force = support::force_scene();
  const std::string plastic = "interface { taylor_quinney_factor: 0.9 plastic_layer: true } ";
  EXPECT_FALSE(scene_model(velocity).options.taylor_quinney_factor);
  for (const v1::Scene& scene :
       {with(velocity, "velocity_driven { taylor_quinney_factor: 0.9 } hard_layer {}"),
        with(force, plastic + "hard_layer {}"), with(force, plastic + "hard_layer {} layer { inertia: true }")})
    EXPECT_EQ(scene_model(scene).options.taylor_quinney_factor, 0.9);
  const char* key = "velocity_driven.taylor_quinney_factor";
  expect_refusals(velocity,
                  {{"velocity_driven { taylor_quinney_factor: 0.9 }", key, "needs [hard_layer]"},
                   {"velocity_driven { taylor_quinney_factor: 0.9 drive: DRIVE_INTERFACE_SLIP } hard_layer {}", key,
                    "all its work is friction there"},
                   {"velocity_driven { taylor_quinney_factor: 1.5 } hard_layer {}", key, "above 0 and at most 1"}});
  expect_refusals(force, {{"velocity_driven { taylor_quinney_factor: 0.9 } hard_layer {}", key,
                           "here the key is interface.taylor_quinney_factor"},
                          {"interface { taylor_quinney_factor: 0.9 } hard_layer {}", "interface.taylor_quinney_factor",
                           "a layer that is rigid does no plastic work"},
                          {plastic, "interface.taylor_quinney_factor", ""}});
}

TEST(SceneOptions, SecondOrderIsSaidToBeOfOpenContactsAndModesAreRefusedWhereTheyWouldMeanNothing) {
  const v1::Scene velocity = support::velocity_scene(), force = support::force_scene(), modes = support::modes_scene();
  EXPECT_EQ(scene_model(force).options.time_integrator, physics::TimeIntegrator::kBackwardEuler);
  EXPECT_FALSE(scene_model(force).options.modes);
  const SceneModel made = scene_model(with(modes, "layer { " + kSecondOrder + "}"));
  EXPECT_EQ(made.options.time_integrator, physics::TimeIntegrator::kSdirk2);
  EXPECT_EQ(made.options.modes->accuracy, 1e-6);
  ASSERT_TRUE(effective_of(made).layer().has_modes());
  expect_own(made);

  const std::string times = "modes { shortest_step_s: 1e-6 longest_time_s: 1e-7 } ",
                    second = "layer { " + kSecondOrder + "} ";
  const std::string plastic = "interface { plastic_layer: true } ";
  expect_refusals(modes, {{second + "hard_layer {}", "layer.heat", "modes follow one body"},
                          {"layer { " + kSecondOrder + times + "}", "layer.modes.longest_time_s", ""},
                          {"layer { cells: 40 }", "layer.cells", "is used only with heat = \"profile\""},
                          {"layer { grading: 1.1 }", "layer.grading", "is used only with heat = \"profile\""},
                          {plastic, "layer.heat", "a layer flows by the temperature inside it"},
                          {"tangential_components: 2 " + kWeakening, "", ""}});
  expect_refusals(force,
                  {{"layer { " + kSecondOrder + times + "}", "layer.modes", ""},
                   {second + plastic, "", ""},  // and a warning, see below
                   {plastic, "", ""},
                   {second + "tangential_components: 2", "", ""},
                   {second + "tangential_components: 2 junctions { contact_fraction: 1 height_m: 1e-7 }", "", ""},
                   {second + "tangential_components: 2 " + kWeakening, "", ""}});
  EXPECT_THAT(physics::Model(scene_model(with(force, second + plastic)).options).warnings(),
              Contains(HasSubstr("open contacts second order")));
  v1::Scene flowing = velocity;
  *flowing.mutable_layer() = modes.layer();
  expect_refusals(flowing, {{"", "layer.heat", "a layer flows by the temperature inside it"}});
  expect_refusals(velocity, {{second, "", ""},
                             {"layer { inertia: true " + kSecondOrder + "}", "", ""},
                             {second + "hard_layer {} velocity_driven { taylor_quinney_factor: 0.9 }", "", ""}});
}

TEST(SceneOptions, AToleranceChoosesGridAndMethodsAndIsRefusedBesideThem) {
  v1::Scene scene = support::velocity_scene();
  scene.clear_layer();
  scene = with(scene, "layer { thickness_m: 20e-6 } tolerance: 1e-3");
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.tolerance, 1e-3);
  EXPECT_EQ(made.options.time_integrator, physics::TimeIntegrator::kSdirk2);
  EXPECT_GT(made.options.grid.cells, 12);
  EXPECT_LT(made.options.grid.cells, 100);
  EXPECT_THAT(physics::Model(made.options).warnings(), Contains(HasSubstr("tolerance 0.001: ")));
  // The effective scene must give the same model again.
  expect_own(made);
  EXPECT_EQ(scene_model(made.effective, "effective").options.grid.cells, made.options.grid.cells);
  scene.set_tolerance(1e-2);
  EXPECT_LT(scene_model(scene).options.grid.cells, made.options.grid.cells);

  scene.mutable_hard_layer();
  const SceneModel two_sided = scene_model(scene);
  EXPECT_EQ(two_sided.options.hard_grid->cells, two_sided.options.grid.cells);
  expect_own(two_sided);
  expect_refusals(scene,
                  {{"hard_layer { cells: 60 }", "hard_layer.cells", ""},
                   {"velocity_driven { taylor_quinney_factor: 0.9 }", "tolerance", "where the flow gathers in a band"},
                   {"layer { inertia: true }", "tolerance", "waves that cross the layer are not seen"},
                   {"layer { cells: 60 }", "layer.cells", ""},
                   {"layer { " + kSecondOrder + "}", "layer.time_integrator", "is the server's choice"},
                   {"layer { sleep: true }", "", ""},
                   {"tolerance: 0.5", "tolerance", ""}});

  scene = support::force_scene();
  scene.clear_layer();
  scene.set_tolerance(1e-4);
  EXPECT_TRUE(scene_model(scene).options.modes);
  scene.mutable_interface()->set_plastic_layer(true);
  EXPECT_FALSE(scene_model(scene).options.modes);
  EXPECT_EQ(scene_model(scene).options.time_integrator, physics::TimeIntegrator::kBackwardEuler);
}

TEST(SceneOptions, InertiaIsRefusedWhereItHasNoMeaning) {
  EXPECT_FALSE(scene_model(support::velocity_scene()).options.inertia);
  const v1::Scene velocity = with(support::velocity_scene(), "layer { inertia: true }"),
                  force = with(support::force_scene(), "layer { inertia: true }");
  const std::string two_sided = "hard_layer {} layer { far_boundary: FAR_BOUNDARY_HALF_SPACE } ";
  EXPECT_TRUE(scene_model(scene_model(velocity).effective, "effective").options.inertia);
  for (const v1::Scene& scene : {velocity, with(velocity, two_sided), with(force, "interface { plastic_layer: true }")})
    EXPECT_TRUE(scene_model(scene).options.inertia);
  expect_refusals(
      velocity, {{two_sided + "velocity_driven { taylor_quinney_factor: 0.9 }", "", ""},
                 {two_sided + "velocity_driven { drive: DRIVE_INTERFACE_SLIP }", "layer.inertia",
                  "does not go with velocity_driven.drive"},
                 {two_sided + "layer { grading: 1 cells: 1001 }", "layer.inertia", "at most 1000 cells, found 1001"}});
  expect_refusals(force, {{"", "layer.inertia", "whose mass has its own already"}});
}

TEST(SceneOptions, WhatTheOtherStrategyReadsIsRefused) {
  expect_refusals(
      support::force_scene(),
      {{"velocity_driven { drive: DRIVE_INTERFACE_SLIP }", "velocity_driven.drive", "is an option of strategy"},
       {"velocity_driven { friction_coefficient: 0.2 }", "velocity_driven.friction_coefficient",
        "is an option of strategy = \"velocity_driven\""},
       {"velocity_driven { drive: DRIVE_LAYER_SHEAR }", "", ""}});  // as earlier effective scenes have it
  EXPECT_THAT(scene_model(support::force_scene()).effective, Not(HasSubstr("[velocity_driven]")));
  const char* const film = "hard_layer {} melt_film { latent_heat_j_per_kg: 4e5 viscosity_pa_s: 1e-3 }";
  EXPECT_EQ(refusal_of(with(support::velocity_scene(), film)).remedy,
            "Leave out [melt_film], or take the other strategy.");
}

TEST(SceneOptions, SleepIsRefusedWhereNothingCouldRest) {
  v1::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.sleep);
  scene = with(scene, "layer { sleep: true }");
  EXPECT_TRUE(scene_model(scene_model(scene).effective, "effective").options.sleep);
  const std::string most =
      "layer { cells: 451 grading: 1 far_boundary: FAR_BOUNDARY_HALF_SPACE } hard_layer { cells: 449 } ";
  expect_refusals(scene,
                  {{"layer { cells: 451 grading: 1 } hard_layer {}", "layer.sleep", "at most 900 cells, found 902"},
                   {most + "layer { inertia: true }", "layer.sleep", "does not go with layer.inertia"}});
  // The largest basis of modes that a scene can ask for: both layers with the most cells and a half-space behind each.
  for (const char* grading : {"1.0", "1.0001"}) {
    const physics::Model model(scene_model(with(scene, most + "layer { grading: " + grading + " }")).options);
    EXPECT_LE(model.layout().num_vertices + model.layout().num_hard_vertices, std::size_t{physics::kMaxBasisVertices});
  }
}

TEST(SceneOptions, TwoComponentsAreRefusedWhereSomethingHasNoDirection) {
  EXPECT_EQ(scene_model(support::velocity_scene()).options.tangential_components, 1);
  const v1::Scene velocity = with(support::velocity_scene(), "tangential_components: 2");
  const v1::Scene force = with(support::force_scene(), "tangential_components: 2");
  for (const v1::Scene& scene : {velocity, force}) EXPECT_EQ(scene_model(scene).options.tangential_components, 2);
  EXPECT_EQ(scene_model(scene_model(velocity).effective, "effective").options.tangential_components, 2);
  expect_refusals(velocity,
                  {{"layer { inertia: true }", "layer.inertia", "waves turn the stress from depth to depth"},
                   {"velocity_driven { drive: DRIVE_INTERFACE_SLIP }", "tangential_components", "has no direction"}});
  expect_refusals(force, {{"tangential_components: 3", "tangential_components", ""}});
}

TEST(SceneOptions, StrengthUnderPressureNeedsItsConstantsAndIsTheSoftBodys) {
  v1::Scene scene = support::velocity_scene();
  EXPECT_FALSE(scene_model(scene).options.soft.varies_with_compression());
  scene = with(scene, "soft { melting_curve: MELTING_CURVE_LINDEMANN pressure_term: PRESSURE_TERM_COMPRESSED }");
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.soft.melting_curve, physics::MeltingCurve::kLindemann);
  EXPECT_EQ(made.options.soft.pressure_term, physics::PressureTerm::kCompressed);
  EXPECT_EQ(scene_model(made.effective, "effective").options.soft.melting_curve, physics::MeltingCurve::kLindemann);

  // The constants of the body are given one by one, except the slope of the Hugoniot, without which no compression can
  // be computed.
  scene.mutable_soft()->clear_material();
  for (const auto& [name, value] : scene::numbers_of(effective_of(made).soft()))
    if (name != "hugoniot_slope") scene::set_numbers({{name, value}}, *scene.mutable_soft());
  const std::string constant = "soft { melting_curve: MELTING_CURVE_CONSTANT pressure_term: PRESSURE_TERM_LINEAR } ";
  expect_refusals(scene, {{"", "soft.hugoniot_slope", ""},
                          {constant, "", ""},
                          {constant + "hard { melting_curve: MELTING_CURVE_LINDEMANN }", "hard.melting_curve",
                           "only the soft body's is computed"}});
}

TEST(SceneOptions, SimonsMeltingCurveHasItsConstantsAndItsMeltingTemperature) {
  const v1::Scene bare = with(support::velocity_scene(), "soft { melting_curve: MELTING_CURVE_SIMON }");
  expect_refusals(bare, {{"", "soft.simon_temperature_k", "needs the constants of the curve"}});
  const v1::Scene scene = with(bare, "soft { simon_temperature_k: 933.45 simon_pressure_pa: 6e9 simon_exponent: 1.9 }");
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.soft.melting_curve, physics::MeltingCurve::kSimon);
  EXPECT_EQ(made.options.soft.melting_temperature, 933.45);
  const SceneModel again = scene_model(made.effective, "effective");
  EXPECT_EQ(again.effective, made.effective);
  EXPECT_EQ(again.options.soft.simon_exponent, 1.9);
  expect_refusals(scene, {{"soft { melting_temperature_k: 1220 }", "soft.melting_temperature_k", ""},
                          {"hard { melting_curve: MELTING_CURVE_SIMON }", "hard.melting_curve", ""}});
}

TEST(SceneOptions, AFaceMayKeepItsTemperature) {
  const std::string held = "far_boundary: FAR_BOUNDARY_ISOTHERMAL";
  const v1::Scene scene = with(support::velocity_scene(), "hard_layer { cells: 5 } layer { " + held + " }");
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.grid.far_boundary, physics::FarBoundary::kIsothermal);
  EXPECT_EQ(made.options.hard_grid->far_boundary, physics::FarBoundary::kIsothermal);
  const v1::Scene hard = with(scene, "hard_layer { " + held + " } layer { far_boundary: FAR_BOUNDARY_INSULATED }");
  EXPECT_EQ(scene_model(hard).options.grid.far_boundary, physics::FarBoundary::kInsulated);
  expect_refusals(hard, {{"layer { sleep: true }", "", ""}});
}

TEST(SceneOptions, ConductivityAndHeatMayFollowTheTemperature) {
  v1::Scene scene = support::velocity_scene();
  EXPECT_FALSE(physics::conducts_by_temperature(scene_model(scene).options));
  scene = with(scene, "soft { thermal_conductivity_slope_per_k: -2e-4 }");
  expect_refusals(scene, {{"", "soft.thermal_conductivity_slope_per_k", "two half-spaces of constant k and c"}});
  const SceneModel made = scene_model(with(scene, "hard { specific_heat_slope_per_k: 3e-4 } hard_layer {}"));
  EXPECT_EQ(made.options.soft.conductivity_slope, -2e-4);
  EXPECT_EQ(made.options.hard.specific_heat_slope, 3e-4);
  EXPECT_EQ(scene_model(made.effective, "effective").options.hard.specific_heat_slope, 3e-4);
}

TEST(SceneOptions, TablesOfConductivityAndHeatAreCheckedRowByRow) {
  const auto fill = [](auto* list, std::initializer_list<double> values) {
    list->Assign(values.begin(), values.end());
  };
  v1::Scene scene = support::velocity_scene();
  scene.mutable_hard_layer();
  v1::Body& soft = *scene.mutable_soft();
  auto* T = soft.mutable_thermal_conductivity_table_temperature_k();
  auto* k = soft.mutable_thermal_conductivity_table_w_per_m_k();
  const double of = scene_model(scene).options.soft.conductivity;
  fill(T, {200.0, 600.0, 1e4});
  EXPECT_EQ(refusal_of(scene).field, "soft.thermal_conductivity_table_temperature_k");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("give soft.thermal_conductivity_table_w_per_m_k, too"));
  fill(k, {of, 0.9 * of});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("has 2 values for 3 temperatures"));
  fill(k, {of, 0.9 * of, 0.8 * of});
  const SceneModel made = scene_model(scene);
  ASSERT_NE(made.options.heat_tables, nullptr);
  EXPECT_EQ(made.options.heat_tables->soft_conductivity.at(400.0), 0.95);
  EXPECT_TRUE(made.options.heat_tables->hard_heat.empty());
  const SceneModel again = scene_model(made.effective, "effective");
  EXPECT_EQ(again.options.heat_tables->soft_conductivity.share, made.options.heat_tables->soft_conductivity.share);
  expect_own(made);

  soft.set_thermal_conductivity_slope_per_k(-2e-4);
  EXPECT_EQ(refusal_of(scene).field, "soft.thermal_conductivity_slope_per_k");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("leave out one of them"));
  soft.clear_thermal_conductivity_slope_per_k();
  fill(T, {200.0, 200.0, 1e4});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("[1] = 200 K is not above the temperature before it, 200 K"));
  fill(T, {400.0, 600.0, 1e4});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("reaches from 400 to 10000 K, and the bodies from the start at 300 K"));
  EXPECT_THAT(refusal_of(scene).remedy, HasSubstr("rows for that range"));
  fill(T, {200.0, 600.0, 900.0});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("to melting at 1220 K"));
  fill(T, {200.0, 600.0, 1e4});
  fill(k, {of, 0.0, of});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("table_w_per_m_k[1] = 0 W m-1 K-1 is out of range, expected above 0"));
  fill(k, {of, 30.0 * of, of});
  EXPECT_EQ(refusal_of(scene).field, "soft.thermal_conductivity_table_w_per_m_k");
  EXPECT_THAT(refusal_of(scene).text,
              HasSubstr("expected a twentieth to 20 times soft.thermal_conductivity_w_per_m_k"));
  fill(T, {200.0});
  fill(k, {of});
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("has 1 values, expected 2 to 100"));
  T->Clear();
  k->Clear();
  scene.clear_hard_layer();
  fill(scene.mutable_hard()->mutable_specific_heat_table_temperature_k(), {200.0, 1e4});
  fill(scene.mutable_hard()->mutable_specific_heat_table_j_per_kg_k(), {500.0, 600.0});
  EXPECT_EQ(refusal_of(scene).field, "hard.specific_heat_table_j_per_kg_k");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("needs [hard_layer]"));
}

const std::vector<std::pair<std::string, double>> kJohnsonCookCopper = {
    {"yield_strength_pa", 90e6},        {"hardening_modulus_pa", 292e6},      {"hardening_exponent", 0.31},
    {"rate_coefficient", 0.025},        {"reference_strain_rate_per_s", 1.0}, {"thermal_softening_exponent", 1.09},
    {"reference_temperature_k", 298.0},
};

TEST(SceneOptions, UnknownMaterialsAreListedWithTheOtherFaults) {
  v1::Scene scene = support::velocity_scene();
  scene.mutable_soft()->set_material("aluminum_dlp");
  scene.mutable_hard()->set_material("bogus");
  const auto refused = [](const std::string& text) { return support::fault_of([&] { scene_model(text, "scene"); }); };
  const std::string text = support::text_of(scene);
  const wire::Status two = refused(text);
  EXPECT_THAT(two.text, HasSubstr("soft.material: \"aluminum_dlp\" is not in the catalog"));
  EXPECT_THAT(two.text, HasSubstr("did you mean \"aluminium_dlp\"?"));
  EXPECT_THAT(two.text, HasSubstr("hard.material: \"bogus\" is not in the catalog"));
  EXPECT_EQ(std::ranges::count(two.text, '\n'), 1);
  EXPECT_THAT(two.text.substr(two.text.find('\n')), ::testing::Not(HasSubstr("did you mean")))
      << "nothing is like bogus";
  const wire::Status three = refused(text + "\n[junctions]\nbogus = 1\n");
  EXPECT_THAT(three.text, HasSubstr("junctions.bogus is not a key"));
  EXPECT_THAT(three.text, HasSubstr("soft.material: "));
  EXPECT_THAT(three.text, HasSubstr("hard.material: "));
}

TEST(SceneOptions, AFlowLawComesWithItsOwnConstantsAndComesBack) {
  v1::Scene scene = support::velocity_scene();
  scene.mutable_soft()->set_flow_law(v1::FLOW_LAW_JOHNSON_COOK);
  // the catalog's yield strength belongs to another flow law
  EXPECT_EQ(refusal_of(scene).field, "soft.yield_strength_pa");
  scene::set_numbers(kJohnsonCookCopper, *scene.mutable_soft());
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.soft.flow_law, physics::FlowLaws::place<physics::JohnsonCook>());
  EXPECT_EQ(made.options.soft.hardening_modulus, 292e6);
  const std::string text = made.effective;
  EXPECT_THAT(text, HasSubstr("flow_law = \"johnson_cook\""));
  EXPECT_THAT(text.substr(0, text.find("[hard]")), ::testing::Not(HasSubstr("hardening_coefficient")));
  expect_own(made);
  const std::string curve = "soft { melting_curve: MELTING_CURVE_LINDEMANN } ";
  expect_refusals(scene, {{"soft { pressure_term: PRESSURE_TERM_COMPRESSED }", "soft.pressure_term", ""},
                          {curve, "", ""},
                          {curve + "layer { " + kSecondOrder + "}", "", ""}});
}

TEST(SceneOptions, AFrictionLawComesWithItsOwnConstantsAndComesBack) {
  EXPECT_EQ(scene_model(support::force_scene()).options.interface.friction_law, physics::FrictionLaw{});
  const v1::Scene scene = with(support::force_scene(), kWeakening);
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.interface.friction_law, physics::FrictionLaws::place<physics::VelocityWeakening>());
  EXPECT_EQ(made.options.interface.friction_coefficient_fast, 0.02);
  EXPECT_EQ(made.options.interface.velocity_decay, 0.01);
  EXPECT_THAT(made.effective, HasSubstr("friction_law = \"velocity_weakening\""));
  expect_own(made);
  expect_refusals(scene, {{"interface { plastic_layer: true }", "", ""}});
}

TEST(SceneOptions, FrictionThatSoftensComesWithItsOwnConstantsAndComesBack) {
  const v1::Scene bare = with(support::force_scene(), "interface { friction_law: FRICTION_LAW_THERMAL_SOFTENING }");
  EXPECT_THAT(refusal_of(bare).text, HasSubstr("interface.friction_reference_temperature_k is missing"));
  const v1::Scene scene =
      with(bare, "interface { friction_reference_temperature_k: 300 friction_softening_exponent: 2 }");
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(made.options.interface.friction_law, physics::FrictionLaws::place<physics::ThermalSoftening>());
  EXPECT_EQ(made.options.interface.friction_reference_temperature, 300.0);
  EXPECT_EQ(made.options.interface.friction_softening_exponent, 2.0);
  expect_own(made);
  expect_refusals(scene, {{"interface { friction_reference_temperature_k: 2000 }",  // above melting
                           "interface.friction_reference_temperature_k", ""}});
}

const std::string kMeltFilm = "melt_film { latent_heat_j_per_kg: 397e3 viscosity_pa_s: 1.25e-3 } ";

TEST(MeltFilmScene, HasItsConstantsAndKeepsThem) {
  const SceneModel made = scene_model(with(support::force_scene(), kMeltFilm + "hard_layer {}"));
  ASSERT_TRUE(made.options.melt_film);
  EXPECT_EQ(made.options.melt_film->latent_heat, 397e3);
  EXPECT_EQ(made.options.melt_film->viscosity, 1.25e-3);
  EXPECT_EQ(made.options.melt_film->activation_energy, 0.0);
  EXPECT_THAT(made.effective, HasSubstr("activation_energy_j_per_mol = 0"));
  expect_own(made);
}

TEST(MeltFilmScene, RefusesWhatItCannotDo) {
  expect_refusals(
      support::force_scene(),
      {{"melt_film { latent_heat_j_per_kg: 397e3 } hard_layer {}", "melt_film", "viscosity_pa_s"},
       {kMeltFilm, "melt_film", "[hard_layer]"},
       {kMeltFilm + "hard_layer {} interface { plastic_layer: true }", "melt_film", "before the interface melts"}});
}

std::string costs_told(const v1::Scene& scene) {
  for (const std::string& warning : physics::Model(scene_model(scene).options).warnings())
    if (warning.starts_with("note: costly: ")) return warning;
  return "";
}

TEST(SceneOptions, ACostlySceneIsWarnedOfWithWhatHelps) {
  EXPECT_EQ(costs_told(support::velocity_scene()), "");
  v1::Scene scene = with(support::velocity_scene(), "soft { material: 'copper_ofhc_jc' }");
  EXPECT_EQ(costs_told(scene), "");
  EXPECT_THAT(costs_told(with(scene, "layer { grading: 1 cells: 5000 }")),
              HasSubstr("fewer cells, graded towards the interface"));
  scene.clear_layer();
  scene.set_tolerance(1e-2);
  EXPECT_EQ(costs_told(scene), "");
  scene.set_tolerance(1e-6);
  EXPECT_THAT(costs_told(scene), HasSubstr("a larger tolerance needs fewer cells and substeps"));
}

// Calls visit(key) for every number of a table and of the tables in it.
void for_each_number(const google::protobuf::Descriptor& table,
                     const std::function<void(const google::protobuf::FieldDescriptor&)>& visit) {
  for (int i = 0; i < table.field_count(); ++i) {
    const auto& field = *table.field(i);
    if (field.message_type() != nullptr)
      for_each_number(*field.message_type(), visit);
    else if (field.cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE)
      visit(field);
  }
}

TEST(UsualValues, EveryNumberWithAUnitHasThemWithinItsBounds) {
  int keys = 0;
  for_each_number(*guest::HydroScene::descriptor(), [&](const google::protobuf::FieldDescriptor& field) {
    SCOPED_TRACE(field.full_name());
    const v1::Rule& rule = scene::rule_of(field);
    const bool has_unit = rule.unit() != "1";
    ASSERT_FALSE(rule.unit().empty());
    EXPECT_EQ(rule.has_usual_from(), rule.has_usual_to());
    EXPECT_TRUE(rule.has_usual_from() || !has_unit);
    if (!rule.has_usual_from()) return;
    ++keys;
    EXPECT_LT(rule.usual_from(), rule.usual_to());
    EXPECT_GE(rule.usual_from(), rule.has_above() ? rule.above() : rule.at_least());
    EXPECT_LE(rule.usual_to(), rule.at_most());
  });
  EXPECT_GT(keys, 40);
}

TEST(UsualValues, NoMaterialAndNoDefaultIsUnusual) {
  for (const auto& entry : physics::catalog()) {
    SCOPED_TRACE(entry.name);
    for (v1::Scene scene : {support::velocity_scene(), support::force_scene()}) {
      scene.mutable_soft()->set_material(std::string(entry.name));
      if (scene.strategy() == v1::STRATEGY_FORCE_DRIVEN) scene.mutable_interface()->set_plastic_layer(true);
      if (entry.name == "titanium_6al_4v") continue;  // has a caution
      EXPECT_THAT(scene_model(scene).warnings, IsEmpty());
    }
  }
}

TEST(UsualValues, AMetalThatIsWeakerHotThanItsConstantsSaysSo) {
  const v1::Scene scene = with(support::force_scene(), "soft { material: 'titanium_6al_4v' }");
  const auto cautions = ElementsAre(HasSubstr("soft.material = \"titanium_6al_4v\": its strength agrees with"));
  const SceneModel made = scene_model(scene);
  EXPECT_THAT(made.warnings, cautions);
  EXPECT_THAT(scene_model(made.effective, "effective").warnings, cautions);
}

TEST(UsualValues, AMetalWithAnotherStrengthThanTheCatalogsHasNoCaution) {
  const auto warnings_with = [](const std::string& soft) {
    v1::Scene scene = support::force_scene();
    scene.clear_soft();
    return scene_model(support::text_of(scene) + "[soft]\nmaterial = \"titanium_6al_4v\"\n" + soft, "soft").warnings;
  };
  EXPECT_THAT(warnings_with("specific_heat_j_per_kg_k = 600.0\n"), SizeIs(1));
  const char* const johnson_cook =
      "flow_law = \"johnson_cook\"\nyield_strength_pa = 1330e6\nhardening_modulus_pa = 1e9\n"
      "hardening_exponent = 0.3\nrate_coefficient = 0.01\nreference_strain_rate_per_s = 1.0\n"
      "thermal_softening_exponent = 1.0\nreference_temperature_k = 298.0";
  for (const char* key : {"temperature_coefficient_per_k = 9e-4", "yield_strength_pa = 9e8",
                          "yield_strength_max_pa = 2e9", "hardening_coefficient = 10.0", "hardening_exponent = 0.2",
                          "pressure_coefficient_per_pa = 1e-11", "melting_temperature_k = 1900.0", johnson_cook})
    EXPECT_THAT(warnings_with(key), IsEmpty()) << key;
}

TEST(UsualValues, ACautionOfTheSceneIsNotRepeatedForItsPairs) {
  const std::string titanium = "material = \"titanium_6al_4v\"\n";
  const std::string hot = "[pair.hot.soft]\n" + titanium,
                    rough = "[pair.rough.interface]\nfriction_coefficient = 0.5\nyield_strength_pa = 290e6\n";
  v1::Scene scene = support::force_scene();
  EXPECT_THAT(scene_model(support::text_of(scene) + hot, "pairs").pairs.front().warnings,
              Contains(HasSubstr("soft.material = \"titanium_6al_4v\"")));
  scene.mutable_soft()->set_material("titanium_6al_4v");
  const SceneModel made = scene_model(support::text_of(scene) + hot + rough, "pairs");
  EXPECT_THAT(made.warnings, SizeIs(1));
  for (const PairModel& pair : made.pairs) EXPECT_THAT(pair.warnings, IsEmpty()) << pair.name;
}

TEST(UsualValues, OtherUnitsAreNamedWithKeyValueAndRange) {
  const v1::Scene scene =
      with(support::force_scene(),
           "interface { yield_strength_pa: 0.2 } layer { thickness_m: 1 } soft { shear_modulus_pa: 27.6 }");
  EXPECT_THAT(
      scene_model(scene).warnings,
      ElementsAre("soft.shear_modulus_pa = 27.6 Pa is unusual: values from 1e6 to 1e12 Pa are expected. Is it in Pa?",
                  "layer.thickness_m = 1 m is unusual: values from 1e-08 to 0.01 m are expected. Is it in m?",
                  "interface.yield_strength_pa = 0.2 Pa is unusual: values from 1e5 to 5e10 Pa are expected. "
                  "Is it in Pa?"));
  // The effective scene, from which a recovered server makes its session, draws the same warnings.
  const SceneModel made = scene_model(scene);
  EXPECT_EQ(scene_model(made.effective, "effective").warnings, made.warnings);
}

TEST(UsualValues, AFrictionCoefficientFarAboveOneIsAsked) {
  v1::Scene scene = support::force_scene();
  scene.mutable_interface()->set_friction_coefficient(1.5);
  EXPECT_THAT(scene_model(scene).warnings, IsEmpty());
  scene.mutable_interface()->set_friction_coefficient(3.0);
  EXPECT_THAT(scene_model(scene).warnings,
              ElementsAre("interface.friction_coefficient = 3 is unusual: values from 0 to 1.5 are expected. Is it "
                          "meant?"));
}

TEST(UsualValues, ConstantsThatContradictEachOtherAreAsked) {
  const std::string weakening =
                        "interface { friction_law: FRICTION_LAW_VELOCITY_WEAKENING velocity_decay_s_per_m: 0.01 ",
                    junctions = "junctions { contact_fraction: 0.5 height_m: 1e-7 ";
  for (const auto& [changes, warning] : std::initializer_list<std::pair<std::string, const char*>>{
           {"soft { yield_strength_pa: 3e8 yield_strength_max_pa: 1e8 } interface { yield_strength_pa: 9e7 }",
            "soft.yield_strength_pa = 3e8 Pa is above soft.yield_strength_max_pa = 1e8 Pa"},
           {"hard { thermal_diffusivity_m2_per_s: 1e-5 }",
            "hard.thermal_diffusivity_m2_per_s = 1e-05 m2 s-1 contradicts conductivity / (density * specific heat) = "
            "4.08e-06 m2 s-1"},
           {junctions + "yield_strength_max_pa: 1e8 }",
            "interface.yield_strength_pa = 2e8 Pa is above junctions.yield_strength_max_pa = 1e8 Pa"},
           {weakening + "friction_coefficient_fast: 0.5 }",
            "interface.friction_coefficient_fast = 0.5 is above interface.friction_coefficient = 0.3"}}) {
    const SceneModel made = scene_model(with(support::force_scene(), changes));
    EXPECT_THAT(made.warnings, ElementsAre(StartsWith(warning)));
    EXPECT_EQ(scene_model(made.effective, "effective").warnings, made.warnings);
  }
  const std::string agree = "soft { yield_strength_max_pa: 2e8 thermal_diffusivity_m2_per_s: 6e-5 } ";
  EXPECT_THAT(
      scene_model(with(support::force_scene(), agree + weakening + "friction_coefficient_fast: 0.3 }")).warnings,
      IsEmpty());
}

// Y* of the paper's aluminium is 301 MPa, calculated independently.
TEST(InterfaceStrength, AboveTheMetalsNeedsAPlasticLayer) {
  const auto warnings_of = [](double strength, bool plastic_layer) {
    v1::Scene scene = support::force_scene();
    scene.mutable_interface()->set_yield_strength_pa(strength);
    scene.mutable_interface()->set_plastic_layer(plastic_layer);
    return scene_model(scene).warnings;
  };
  EXPECT_THAT(warnings_of(299e6, false), IsEmpty());
  EXPECT_THAT(warnings_of(303e6, false), SizeIs(1));
  EXPECT_THAT(warnings_of(680e6, false),
              ElementsAre(AllOf(StartsWith("interface.yield_strength_pa = 6.8e+08 Pa is above Y* = 3.0"),
                                HasSubstr("set interface.plastic_layer = true"))));
  EXPECT_THAT(warnings_of(680e6, true), IsEmpty()) << "the layer flows";
  EXPECT_THAT(warnings_of(10e9, false),
              ElementsAre(StartsWith("note: interface.yield_strength_pa = 1e+10 Pa is above")))
      << "no metal is as strong: meant as no limit";
}

TEST(InterfaceStrength, OfJunctionsIsTheirShareOfTheArea) {
  v1::Scene scene = support::force_scene();
  scene.mutable_interface()->set_yield_strength_pa(400e6);
  scene.mutable_junctions()->set_contact_fraction(0.5);
  scene.mutable_junctions()->set_height_m(1e-6);
  EXPECT_THAT(scene_model(scene).warnings, IsEmpty());
  scene.mutable_junctions()->set_contact_fraction(0.9);
  EXPECT_THAT(scene_model(scene).warnings, ElementsAre(StartsWith("interface.yield_strength_pa * "
                                                                  "junctions.contact_fraction = 3.6e+08 Pa")));
}

TEST(UsualValues, AZeroThatSwitchesATermOffIsNoWarning) {
  const std::string zeros = "soft { pressure_coefficient_per_pa: 0 temperature_coefficient_per_k: 0 }";
  EXPECT_THAT(scene_model(with(support::velocity_scene(), zeros)).warnings, IsEmpty());
}

TEST(UsualValues, APairIsNamedWithItsTable) {
  const std::string text = support::text_of(support::force_scene()) +
                           "[pair.a.interface]\nfriction_coefficient = 0.1\nyield_strength_pa = 200\n";
  EXPECT_THAT(scene_model(text, "s").warnings,
              ElementsAre(HasSubstr("pair.a.interface.yield_strength_pa = 200 Pa is unusual")));
}

TEST(UsualValues, WhatFollowsFromAnUnusualValueIsNotAskedAgain) {
  const SceneModel made = scene_model(with(support::force_scene(), "soft { density_kg_per_m3: 2.7 }"));
  EXPECT_THAT(made.warnings, ElementsAre(HasSubstr("soft.density_kg_per_m3 = 2.7")));
  EXPECT_EQ(scene_model(made.effective, "effective").warnings, made.warnings);
}

// The words for flow laws and friction laws in a scene must be the names of the registered laws, in the same order.
TEST(SceneOptions, EveryRegisteredLawHasItsWord) {
  const std::string reference = scene::reference_of(*v1::Scene::descriptor());
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
