// Tests of the two-dimensional hydrocode, coupled to the layer model through the message bus.
#include <gtest/gtest.h>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/history.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "proto/scene/scene.hpp"
#include "shearbus_places.hpp"
#include "tests/support/hydro2d_plates.hpp"

namespace shearbus {
namespace {

using lagrange::Cycle;

// The middle of two plates behaves as two half-spaces until a wave arrives from an end of the plates. The expected
// values of stress, jump and temperature are the exact solution for two half-spaces, tests/measured.toml, "Exact
// solutions".
TEST(Hydro2dSubgrid, TwoHalfSpacesSlideAsTheVolterraEquationSays) {
  const hydro::SceneText scene{R"(
name = "two_half_spaces_2d"
strategy = "force_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 20e-6
cells = 500
far_boundary = "half_space"
[interface]
friction_coefficient = 0.3
yield_strength_pa = 200e6
)",
                               "two_half_spaces_2d.toml"};
  test::Plates plates;
  plates.length = 1.6e-3;
  plates.width = 20e-6;
  plates.pressure = 11.2e9;
  lagrange::Bodies bodies = test::plates(plates);
  const std::size_t nodes = bodies.slide_lines.front().soft.nodes.size();
  hydro::SubgridLaw law(scene, hydro::node_ids(nodes), std::vector<double>(nodes, 300.0));
  Cycle cycle(std::move(bodies), &law);
  cycle.run_to(1e-7);
  const std::size_t middle = nodes / 2;
  const hydro::InterfaceAnswer& answer = cycle.contact().answer();
  std::printf(
      "two half-spaces in two dimensions, 100 ns: s %.3f MPa (185.992), [V] %.3f m/s (70.925), T0 %.2f K (492.23)\n",
      answer.shear_stress[middle] * 1e-6, answer.velocity_jump_new[middle], answer.interface_temperature[middle]);
  EXPECT_NEAR(answer.shear_stress[middle] / 185.992e6, 1.0, 0.002);
  EXPECT_NEAR(answer.velocity_jump_new[middle] / 70.925, 1.0, 0.003);
  EXPECT_NEAR(answer.interface_temperature[middle], 492.23, 1.5);
}

guest::HydroScene cone() {
  guest::HydroScene scene =
      hydro::load_scene(SHEARBUS_SOURCE_DIR "/hydro_stub/problems/cone_al_steel_coarse.toml").scene;
  scene.mutable_hydro()->mutable_cone_target()->set_zone_width_m(1e-3);
  scene.mutable_hydro()->set_end_time_s(4e-6);
  return scene;
}

hydro::SceneText text_of(const guest::HydroScene& scene) {
  return {scene::to_toml(scene.scene()), "scene"};
}

// The bound of the work of friction is that of bodies that keep their heat.
TEST(Hydro2dCone, TheHeatBoundIsOffWhereHeatLeaves) {
  guest::HydroScene scene = cone();
  scene.mutable_hydro()->set_interface_law(guest::INTERFACE_LAW_SUBGRID);
  EXPECT_TRUE(hydro::make_cone_target(scene).heat_bound.has_value());
  guest::HydroScene behind = scene;
  behind.mutable_scene()->mutable_hard_layer()->set_far_boundary(v1::FAR_BOUNDARY_ISOTHERMAL);
  EXPECT_FALSE(hydro::make_cone_target(behind).heat_bound.has_value());
  scene.mutable_scene()->mutable_layer()->set_far_boundary(v1::FAR_BOUNDARY_ISOTHERMAL);
  EXPECT_FALSE(hydro::make_cone_target(scene).heat_bound.has_value());
}

// Runs the cone with two scenes. The first has junctions and solves every node in every step. The second has no
// junctions, and its nodes at rest sleep, so they are not solved. The junctions cover the whole area and do not harden,
// so they change no bit of the answers.
TEST(Hydro2dCone, WhatIsLeftOutIsNotMissed) {
  guest::HydroScene everything = cone();
  everything.mutable_hydro()->set_end_time_s(12e-6);
  v1::Layer& layer = *everything.mutable_scene()->mutable_layer();
  layer.Clear();
  layer.set_thickness_m(100e-6);
  layer.set_cells(80);
  layer.set_grading(1.06);
  layer.set_far_boundary(v1::FAR_BOUNDARY_HALF_SPACE);
  scene::fill_defaults(everything);
  guest::HydroScene sparing = everything;
  v1::Junctions& junctions = *everything.mutable_scene()->mutable_junctions();
  junctions.set_contact_fraction(1.0);
  junctions.set_height_m(1e-6);
  junctions.set_hardening_coefficient(0.0);
  sparing.mutable_scene()->mutable_layer()->set_sleep(true);
  const hydro::ConeTarget problem = hydro::make_cone_target(everything);
  const std::size_t nodes = hydro::interface_nodes(hydro::make_bodies(problem));
  const std::vector<double> temperature(nodes, 300.0);
  hydro::SubgridLaw solved(text_of(everything), hydro::node_ids(nodes), temperature);
  hydro::SubgridLaw sleeping(text_of(sparing), hydro::node_ids(nodes), temperature);
  Cycle all(hydro::make_bodies(problem), &solved), few(hydro::make_bodies(problem), &sleeping);
  double apart = 0.0, stress_apart = 0.0;
  while (all.state().time < problem.end_time) {
    all.advance(problem.end_time);
    few.advance(problem.end_time);
    const hydro::InterfaceAnswer& a = all.contact().answer();
    const hydro::InterfaceAnswer& b = few.contact().answer();
    ASSERT_EQ(a.regime, b.regime) << "step " << all.steps();
    for (std::size_t i = 0; i < nodes; ++i) {
      apart = std::max(apart, std::abs(a.interface_temperature[i] - b.interface_temperature[i]));
      stress_apart = std::max(stress_apart, std::abs(a.shear_stress[i] - b.shear_stress[i]));
    }
  }
  EXPECT_LT(apart, 1e-6);         // largest difference of T0 between the two runs [K]; T0 reaches about 1200 K
  EXPECT_LT(stress_apart, 10.0);  // largest difference of the stress between the two runs [Pa]; it is about 1e8 Pa
  sleeping.close();
  const auto lines = sleeping.omitted_cost().lines;
  ASSERT_EQ(lines.size(), 2U);
  std::printf("cone, %llu steps: apart by %.1e K, %.1e Pa; left out: %s; asleep: %s\n",
              static_cast<unsigned long long>(few.steps()), apart, stress_apart, lines[0].second.c_str(),
              lines[1].second.c_str());
  EXPECT_GT(std::stod(lines[1].second), 40.0);  // share of node-steps in which the node sleeps  [%]
}

// After a step that the host takes back, the next step must give the same bits as if the first had not been made.
TEST(Hydro2dSubgrid, AStepTakenBackLeavesNoTrace) {
  const guest::HydroScene scene = cone();
  constexpr std::size_t kNodes = 9;
  hydro::InterfaceInputs in(kNodes);
  for (std::size_t i = 0; i < kNodes; ++i) {
    in.velocity_jump[i] = 20.0 + 40.0 * static_cast<double>(i);
    in.pressure[i] = 8e9;
    in.mass_soft[i] = 0.7;
    in.mass_hard[i] = 2.0;
  }
  in.dt = 2e-9;
  const std::vector<double> temperature(kNodes, 300.0);
  hydro::SubgridLaw tried(text_of(scene), hydro::node_ids(kNodes), temperature),
      straight(text_of(scene), hydro::node_ids(kNodes), temperature);
  hydro::InterfaceAnswer a(kNodes), b(kNodes);
  for (std::uint64_t step = 1; step <= 20; ++step) {
    in.step = step;
    in.time += in.dt;
    if (step % 3 == 0) {
      hydro::InterfaceInputs longer = in;
      longer.dt *= 4.0;
      tried.advance(longer, a);
      tried.take_back();
    }
    tried.advance(in, a);
    straight.advance(in, b);
    ASSERT_EQ(a.shear_stress, b.shear_stress) << "step " << step;
    ASSERT_EQ(a.interface_temperature, b.interface_temperature);
  }
  tried.close();
  straight.close();
}

}  // namespace
}  // namespace shearbus
