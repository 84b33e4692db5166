// An interface law that calls the subgrid model directly, without service or bus.
#pragma once

#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus::test {

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

}  // namespace shearbus::test
