// The hydrocode coupled to an embedded server, against the subgrid model in its place.
#include <gtest/gtest.h>

#include <vector>

#include "hydro_stub/history.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/shear_column.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus {
namespace {

using hydro::ShearColumn;

// An interface law that calls the subgrid model directly, without service or bus.
class DirectLaw : public hydro::InterfaceLaw {
 public:
  DirectLaw(const physics::ModelOptions& options, const std::vector<double>& temperature)
      : model_(options), nodes_(temperature.size()) {
    const std::size_t doubles = model_.layout().doubles;
    for (std::size_t first = 0; first < nodes_; first += physics::kLanes) {
      double initial[physics::kLanes];
      for (int lane = 0; lane < physics::kLanes; ++lane)
        initial[lane] = temperature[std::min(first + lane, nodes_ - 1)];
      committed_.emplace_back(doubles);
      model_.initialise(committed_.back().data(), reinterpret_cast<const double(&)[physics::kLanes]>(initial));
    }
    trial_.resize(doubles);
  }

  void advance(const hydro::InterfaceInputs& in, hydro::InterfaceAnswer& out) override {
    const auto operators = model_.operators(in.dt);
    for (std::size_t tile = 0; tile < committed_.size(); ++tile) {
      physics::TileInputs inputs;
      for (std::size_t lane = 0; lane < physics::kLanes; ++lane) {
        const std::size_t i = tile * physics::kLanes + lane;
        if (i >= nodes_) break;
        inputs.active |= 1U << lane;
        inputs.velocity_jump[lane] = in.velocity_jump[i];
        inputs.pressure[lane] = in.pressure[i];
        inputs.stress_soft[lane] = in.stress_soft[i];
        inputs.stress_hard[lane] = in.stress_hard[i];
        inputs.mass_soft[lane] = in.mass_soft[i];
        inputs.mass_hard[lane] = in.mass_hard[i];
      }
      physics::TileOutputs outputs;
      model_.advance(*operators, inputs, committed_[tile].data(), trial_.data(), outputs);
      committed_[tile] = trial_;
      for (std::size_t lane = 0; lane < physics::kLanes; ++lane) {
        const std::size_t i = tile * physics::kLanes + lane;
        if (i >= nodes_) break;
        out.shear_stress[i] = outputs.shear_stress[lane];
        out.velocity_jump_new[i] = outputs.velocity_jump_new[lane];
        out.sliding_velocity[i] = outputs.sliding_velocity[lane];
        out.interface_temperature[i] = outputs.interface_temperature[lane];
        out.friction_heat[i] = outputs.friction_heat[lane];
        out.regime[i] = static_cast<std::uint8_t>(outputs.regime[lane]);
      }
    }
  }
  hydro::LawTime time_spent() const override { return {}; }

 private:
  physics::Model model_;
  std::size_t nodes_;
  std::vector<std::vector<double>> committed_;
  std::vector<double> trial_;
};

// The columns stick, slip, melt, slip backwards and stop; they are more than a tile has nodes.
TEST(SubgridLaw, BusAndServerKeepEveryBitOfTheModel) {
  const hydro::SceneFile of = hydro::parse_scene(R"(
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
  const hydro::ColumnProblem problem = hydro::make_problem(of.scene);
  hydro::SubgridLaw law({of.server_text(), of.document.file}, hydro::node_ids(problem.columns),
                        problem.initial_temperature);
  DirectLaw direct(
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

}  // namespace
}  // namespace shearbus
