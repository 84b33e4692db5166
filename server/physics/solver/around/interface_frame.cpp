#include "server/physics/solver/around/interface_frame.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {
namespace {

using Vector = Eigen::Vector2d;

// The length of a vector: exact for a vector along an axis, and without overflow.
double length(const Vector& a) {
  const double largest = std::max(std::abs(a.x()), std::abs(a.y()));
  if (largest == 0.0) return 0.0;
  const double x = a.x() / largest;
  const double y = a.y() / largest;
  return largest * std::sqrt(x * x + y * y);
}

// The inputs of one lane and its stress before the step, as vectors.
struct LaneVectors {
  Vector jump, stress_soft, stress_hard, stress_old;
};

LaneVectors vectors_of(const TileLayout& layout, const TileInputs& inputs, const double* committed, int l) {
  return {{inputs.velocity_jump[l], inputs.second_velocity_jump[l]},
          {inputs.stress_soft[l], inputs.second_stress_soft[l]},
          {inputs.stress_hard[l], inputs.second_stress_hard[l]},
          {committed[layout.shear_stress + l], committed[layout.second_stress + l]}};
}

// The trial vector, along which the scalar step is solved. Velocity-driven: the stress of an elastic layer, DLP (37).
// Force-driven: the jump of an interface without friction, DLP (61).
Vector trial_of(const ModelOptions& options, const LaneVectors& lane, const TileInputs& inputs, double dt, int l) {
  if (options.strategy == Strategy::kForceDriven) {
    return lane.jump +
           dt * ((1.0 / inputs.mass_soft[l]) * lane.stress_soft + (1.0 / inputs.mass_hard[l]) * lane.stress_hard);
  }
  return lane.stress_old + (options.soft.shear_modulus * dt / options.grid.thickness) * lane.jump;
}

Vector direction_of(const Vector& trial, const Vector& otherwise) {
  for (const Vector& along : {trial, otherwise})
    if (const double size = length(along); size > 0.0) return {along.x() / size, along.y() / size};
  return {1.0, 0.0};
}

}  // namespace

InterfaceFrame::InterfaceFrame(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                               const double* committed)
    : problem_(problem), inputs_(inputs), committed_(committed) {
  if (problem.options.plastic_layer && !problem.options.inertia) add_host_shear();
  if (problem.options.tangential_components == 2) look_along_one_direction(operators);
}

void InterfaceFrame::leave(double* trial, TileOutputs& outputs) const {
  if (along_) turn_back(trial, outputs);
  if (!sheared_) return;
  // Makes of the jumps that the interface has after the step those of the host.
  const auto take = [&](const double* shear, const double* jump, double* jump_new) {
    for (const int l : lanes_of(inputs_.active)) {
      const bool failed = (outputs.outcome[l] & kFailed) != 0;  // keeps the jump to its last digit
      if (shear[l] != 0.0) jump_new[l] = failed ? jump[l] : jump_new[l] - shear[l];
    }
  };
  take(shear_[0], inputs_.velocity_jump, outputs.velocity_jump_new);
  if (along_) take(shear_[1], inputs_.second_velocity_jump, outputs.second_velocity_jump_new);
}

void InterfaceFrame::add_host_shear() {
  const double per_rate = kSqrt3 * problem_.options.grid.thickness;
  const auto add = [&](const double* rate, double(&shear)[kLanes], double(TileInputs::*jump)[kLanes]) {
    std::fill_n(shear, kLanes, 0.0);
    for (const int l : lanes_of(inputs_.active)) {
      if (rate[l] == 0.0 || inputs_.pressure[l] <= 0.0) continue;  // a jump of -0 stays one, whatever other lanes have
      if (!sheared_) sheared_ = inputs_;
      shear[l] = per_rate * rate[l];
      ((*sheared_).*jump)[l] += shear[l];
    }
  };
  add(inputs_.soft_plastic_strain_rate, shear_[0], &TileInputs::velocity_jump);
  if (problem_.options.tangential_components == 2)
    add(inputs_.second_soft_plastic_strain_rate, shear_[1], &TileInputs::second_velocity_jump);
}

void InterfaceFrame::look_along_one_direction(const StepOperators& operators) {
  const bool forced = problem_.options.strategy == Strategy::kForceDriven;
  along_ = seen();
  for (const int l : lanes_of(inputs_.active)) {
    const LaneVectors lane = vectors_of(problem_.layout, seen(), committed_, l);
    const Vector e = direction_of(trial_of(problem_.options, lane, inputs_, operators.dt(), l),
                                  forced ? lane.stress_old : lane.jump);
    first_[l] = e.x();
    second_[l] = e.y();
    stress_old_[l] = lane.stress_old.dot(e);
    along_->velocity_jump[l] = lane.jump.dot(e);
    along_->stress_soft[l] = lane.stress_soft.dot(e);
    along_->stress_hard[l] = lane.stress_hard.dot(e);
  }
  along_->stress_before = stress_old_;
}

void InterfaceFrame::turn_back(double* trial, TileOutputs& outputs) const {
  const TileLayout& layout = problem_.layout;
  const bool forced = problem_.options.strategy == Strategy::kForceDriven;
  for (const int l : lanes_of(inputs_.active)) {
    const LaneVectors lane = vectors_of(layout, seen(), committed_, l);
    const Vector e{first_[l], second_[l]};
    Vector stress = outputs.shear_stress[l] * e;
    Vector slip = outputs.sliding_velocity[l] * e;
    Vector jump_new = forced ? Vector(outputs.velocity_jump_new[l] * e) : lane.jump;
    const bool failed = (outputs.outcome[l] & kFailed) != 0, open = outputs.regime[l] == Regime::kOpen;
    if (failed) {  // a node whose step failed keeps its old stress and jump
      stress = lane.stress_old;
      jump_new = lane.jump;
    } else if (open) {
      slip = 0.5 * (lane.jump + jump_new);  // an open contact slips by the mean jump, which need not lie along e
    } else if (!forced) {
      const double apart = length(slip + -1.0 * lane.jump);
      outputs.outcome[l] &= static_cast<std::uint8_t>(~kOutsideDomain);
      if (!(apart <= kOutsideDomainShare * length(lane.jump))) outputs.outcome[l] |= kOutsideDomain;
    }
    if (inputs_.wants_mean_stress) {
      // The part of the old stress across e ends at 0, along a straight path.
      const Vector across = lane.stress_old + -stress_old_[l] * e;
      Vector mean = open ? Vector(0.0, 0.0) : Vector(outputs.mean_shear_stress[l] * e + 0.5 * across);
      if (failed) mean = lane.stress_old;
      outputs.mean_shear_stress[l] = mean.x();
      outputs.second_mean_shear_stress[l] = mean.y();
    }
    trial[layout.shear_stress + l] = outputs.shear_stress[l] = stress.x();
    trial[layout.second_stress + l] = outputs.second_shear_stress[l] = stress.y();
    outputs.sliding_velocity[l] = slip.x();
    outputs.second_sliding_velocity[l] = slip.y();
    outputs.velocity_jump_new[l] = jump_new.x();
    outputs.second_velocity_jump_new[l] = jump_new.y();
  }
}

}  // namespace shearbus::physics
