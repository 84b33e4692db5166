// Tests of the hydrocode coupled to an embedded server, for properties that the coupling of every host must have.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "hydro_stub/history.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/shear_column.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "tests/support/direct_law.hpp"

namespace shearbus {
namespace {

using hydro::ShearColumn;

// Returns a scene whose columns stick, slip, melt, slip backwards and stop. It has more columns than a tile has nodes.
hydro::SceneFile scene() {
  return hydro::parse_scene(R"(
name = "coupled"
strategy = "force_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 60e-6
cells = 60
grading = 1.08
far_boundary = "half_space"
[interface]
friction_coefficient = 0.3
yield_strength_pa = 200e6
[hydro]
end_time_s = 1.5e-6
[hydro.shear_column]
length_m = 1e-3
zones = 200
far_end = "free"
velocity_jump_m_per_s = [5.0, 28.0, 33.0, 60.0, -60.0, 100.0, 180.0, -250.0, 320.0, 400.0, 45.0]
initial_temperature_k = [300.0, 300.0, 300.0, 300.0, 300.0, 500.0, 300.0, 300.0, 900.0, 300.0, 300.0]
pressure_pa = [11.2e9, 11.2e9, 11.2e9, 11.2e9, 11.2e9, 2e9, 0.3e9, 1e9, 11.2e9, 11.2e9, -1e9]
)",
                            "coupled.toml");
}

TEST(SubgridLaw, BusAndServerKeepEveryBitOfTheModel) {
  const hydro::SceneFile of = scene();
  const hydro::ColumnProblem problem = hydro::make_problem(of.scene);
  hydro::SubgridLaw law({of.server_text(), of.document.file}, hydro::node_ids(problem.columns),
                        problem.initial_temperature);
  test::DirectLaw direct(
      {.strategy = physics::Strategy::kForceDriven,
       .soft = problem.soft_material,
       .hard = problem.hard_material,
       .grid = {.thickness = 60e-6, .cells = 60, .grading = 1.08, .far_boundary = physics::FarBoundary::kHalfSpace},
       .interface = {.friction_coefficient = 0.3, .yield_strength = 200e6}},
      problem.initial_temperature);
  ShearColumn through_the_bus(problem);
  ShearColumn in_place(problem);
  unsigned regimes = 0;
  for (std::uint64_t step = 0; step < problem.steps; ++step) {
    through_the_bus.advance(law);
    in_place.advance(direct);
    ASSERT_EQ(through_the_bus.answer().shear_stress, in_place.answer().shear_stress) << "step " << step;
    ASSERT_EQ(through_the_bus.answer().velocity_jump_new, in_place.answer().velocity_jump_new) << "step " << step;
    ASSERT_EQ(through_the_bus.answer().interface_temperature, in_place.answer().interface_temperature)
        << "step " << step;
    ASSERT_EQ(through_the_bus.answer().friction_heat, in_place.answer().friction_heat) << "step " << step;
    ASSERT_EQ(through_the_bus.answer().regime, in_place.answer().regime) << "step " << step;
    for (const std::uint8_t regime : in_place.answer().regime) regimes |= 1U << regime;
  }
  EXPECT_EQ(regimes, 0b11111U) << "the columns pass through every regime";
  law.close();
}

// Metal beside the interface that flows along s drags the interface along, whatever the sign of the jump of its nodes: the
// law is that of the jump and the shear together, DLP (64). Columns: jump and shear along each other; the same sum of
// both with the jump against the shear; their mirror images.
TEST(SubgridLaw, PlasticShearAgainstTheJumpKeepsItsDirection) {
  const double thickness = 0.125e-3, drive = std::sqrt(3.0) * thickness * 4e4;  // 8.7 m/s
  const hydro::SceneFile of = hydro::parse_scene(R"(
name = "layer"
strategy = "force_driven"
[soft]
material = "aluminium_dlp"
yield_strength_max_pa = 0.68e9
[hard]
material = "steel_dlp"
[layer]
cells = 40
grading = 1.12
far_boundary = "half_space"
[interface]
friction_coefficient = 0.3
yield_strength_pa = 0.68e9
plastic_layer = true
[hydro]
end_time_s = 1e-6
[hydro.shear_column]
length_m = 1e-3
zones = 4
velocity_jump_m_per_s = [1.0]
pressure_pa = [4e9]
)",
                                                 "layer.toml");
  constexpr std::size_t kNodes = 4;
  const std::vector<double> temperature(kNodes, 300.0), layers(kNodes, thickness);
  hydro::SubgridLaw law({of.server_text(), of.document.file}, hydro::node_ids(kNodes), temperature,
                        {.address = {}, .state_dir = {}, .check_closure = false}, layers);
  hydro::InterfaceInputs in(kNodes);
  hydro::InterfaceAnswer answer(kNodes);
  const auto mirrored = [](double a, double b) { return std::vector<double>{a, b, -a, -b}; };
  in.dt = 7e-9;
  in.pressure.assign(kNodes, 4e9);
  in.mass_soft.assign(kNodes, 2703.0 * thickness);
  in.mass_hard.assign(kNodes, 7900.0 * thickness);
  in.velocity_jump = mirrored(3.0, -5.0);
  in.stress_soft = in.stress_hard = mirrored(140e6, 140e6);
  in.soft_plastic_strain_rate = mirrored((drive - 8.0) / drive * 4e4, 4e4);
  for (in.step = 1; in.step <= 20; ++in.step) {
    in.time = static_cast<double>(in.step) * in.dt;
    law.advance(in, answer);
    ASSERT_GT(answer.shear_stress[0], 100e6);
    ASSERT_GT(answer.sliding_velocity[0], 0.0);
    ASSERT_NEAR(answer.shear_stress[1] / answer.shear_stress[0], 1.0, 1e-9) << in.step;
    ASSERT_NEAR(answer.sliding_velocity[1], answer.sliding_velocity[0], 1e-7);
    ASSERT_NEAR(answer.velocity_jump_new[1], answer.velocity_jump_new[0] - 8.0, 1e-7);
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
      ASSERT_EQ(answer.shear_stress[i + 2], -answer.shear_stress[i]);
      ASSERT_EQ(answer.velocity_jump_new[i + 2], -answer.velocity_jump_new[i]);
    }
  }
  law.close();
}

}  // namespace
}  // namespace shearbus
