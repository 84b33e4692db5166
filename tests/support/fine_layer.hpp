// A reference solution for steps with a tolerance: the layer of one node, advanced in many equal substeps of each host
// step without error control.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus::test {

// Advances lane 0 of a model by substeps of a given length. A force-driven substep in which the slip reverses or stops
// is halved up to 24 times, which isolates the time of the reversal.
class FineLayer {
 public:
  FineLayer(const physics::ModelOptions& options, double substep)
      : model_(options), state_(model_.layout().doubles), next_(state_.size()) {
    double temperature[physics::kLanes];
    std::fill_n(temperature, physics::kLanes, model_.options().initial_temperature);
    model_.initialise(state_.data(), temperature);
    set_substep(substep);
  }

  // The length of the substeps from now on.
  void set_substep(double substep) {
    const int cuts = model_.options().strategy == physics::Strategy::kForceDriven ? kCuts : 0;
    auto& made = by_length_[substep];
    if (made.empty())
      for (int k = 0; k <= cuts; ++k) made.push_back(model_.operators(std::ldexp(substep, -k)));
    operators_ = made;
  }

  double conducted_share() const {
    const physics::ModelOptions& options = model_.options();
    return options.hard_grid ? 1.0 : physics::heat_partition(options.soft, options.hard);
  }

  // Advances lane 0 by one substep, the fraction `share` of the host's step, halved `cuts` times so far. Adds its part
  // to `step`, the outputs of the host's step, and stores the new velocity jump in `inputs` for the next substep.
  void advance(physics::TileInputs& inputs, double share, physics::TileOutputs& step, std::size_t cuts = 0) {
    physics::TileOutputs out{};
    model_.advance(*operators_[cuts], inputs, state_.data(), next_.data(), out);
    const double before = inputs.velocity_jump[0];
    if (before != 0.0 && !(before * out.velocity_jump_new[0] > 0.0) && cuts + 1 < operators_.size()) {
      for (int half = 0; half < 2; ++half) advance(inputs, 0.5 * share, step, cuts + 1);
      return;
    }
    std::swap(state_, next_);
    std::copy_n(out.velocity_jump_new, physics::kLanes, inputs.velocity_jump);
    std::copy_n(out.velocity_jump_new, physics::kLanes, step.velocity_jump_new);
    step.shear_stress[0] += share * out.shear_stress[0];
    step.friction_heat[0] += out.friction_heat[0];
    step.interface_temperature[0] = out.interface_temperature[0];
  }

 private:
  static constexpr int kCuts = 24;

  physics::Model model_;
  std::vector<double> state_, next_;
  std::vector<std::shared_ptr<const physics::StepOperators>> operators_;
  std::map<double, std::vector<std::shared_ptr<const physics::StepOperators>>> by_length_;
};

}  // namespace shearbus::test
