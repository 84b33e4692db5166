#include "server/physics/solver/around/interface_frame.hpp"

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

bool HostShear::acts(const Problem& problem, const TileInputs& inputs) {
  if (!problem.options.plastic_layer || problem.options.inertia) return false;
  const bool two = problem.options.tangential_components == 2;
  for (const int l : lanes_of(inputs.active))
    if (inputs.soft_plastic_strain_rate[l] != 0.0 || (two && inputs.second_soft_plastic_strain_rate[l] != 0.0))
      return true;
  return false;
}

HostShear::HostShear(const Problem& problem, const TileInputs& inputs) : seen_(inputs) {
  const double per_rate = kSqrt3 * problem.options.grid.thickness;
  const auto add = [&](const double* rate, double(&shear)[kLanes], double* jump) {
    for (const int l : lanes_of(inputs.active)) {
      if (rate[l] == 0.0 || inputs.pressure[l] <= 0.0) continue;  // a jump of -0 stays one, whatever other lanes have
      shear[l] = per_rate * rate[l];
      jump[l] += shear[l];
    }
  };
  add(inputs.soft_plastic_strain_rate, shear_, seen_.velocity_jump);
  if (problem.options.tangential_components == 2)
    add(inputs.second_soft_plastic_strain_rate, second_shear_, seen_.second_velocity_jump);
}

void HostShear::leave(const TileInputs& inputs, TileOutputs& outputs) const {
  const auto take = [&](const double* shear, const double* jump, double* jump_new) {
    for (const int l : lanes_of(inputs.active)) {
      const bool failed = (outputs.outcome[l] & kFailed) != 0;  // keeps the jump to its last digit
      if (shear[l] != 0.0) jump_new[l] = failed ? jump[l] : jump_new[l] - shear[l];
    }
  };
  take(shear_, inputs.velocity_jump, outputs.velocity_jump_new);
  take(second_shear_, inputs.second_velocity_jump, outputs.second_velocity_jump_new);
}

InterfaceFrame::InterfaceFrame(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                               const double* committed)
    : problem_(problem), inputs_(inputs), committed_(committed) {
  if (HostShear::acts(problem, inputs)) shear_.emplace(problem, inputs);
  if (problem.options.tangential_components == 2) scalar_.emplace(problem, operators, seen(), committed);
}

void InterfaceFrame::leave(double* trial, TileOutputs& outputs) const {
  if (scalar_) scalar_->turn(problem_, seen(), committed_, trial, outputs);
  if (shear_) shear_->leave(inputs_, outputs);
}

}  // namespace shearbus::physics
