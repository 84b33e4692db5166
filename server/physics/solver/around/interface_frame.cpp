#include "server/physics/solver/around/interface_frame.hpp"

#include <algorithm>
#include <cmath>

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {
namespace {

struct Vector {
  double first = 0.0;
  double second = 0.0;
};
Vector operator+(const Vector& a, const Vector& b) {
  return {a.first + b.first, a.second + b.second};
}
Vector operator*(double a, const Vector& b) {
  return {a * b.first, a * b.second};
}
double dot(const Vector& a, const Vector& b) {
  return a.first * b.first + a.second * b.second;
}
// The length of a vector: exact for a vector along an axis, and without overflow.
double length(const Vector& a) {
  const double largest = std::max(std::abs(a.first), std::abs(a.second));
  if (largest == 0.0) return 0.0;
  const double x = a.first / largest;
  const double y = a.second / largest;
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
    if (const double size = length(along); size > 0.0) return {along.first / size, along.second / size};
  return {1.0, 0.0};
}

}  // namespace

ScalarStep::ScalarStep(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                       const double* committed)
    : along_(inputs) {
  const bool forced = problem.options.strategy == Strategy::kForceDriven;
  for (const int l : lanes_of(inputs.active)) {
    const LaneVectors lane = vectors_of(problem.layout, inputs, committed, l);
    const Vector e =
        direction_of(trial_of(problem.options, lane, inputs, operators.dt(), l), forced ? lane.stress_old : lane.jump);
    first_[l] = e.first;
    second_[l] = e.second;
    stress_old_[l] = dot(lane.stress_old, e);
    along_.velocity_jump[l] = dot(lane.jump, e);
    along_.stress_soft[l] = dot(lane.stress_soft, e);
    along_.stress_hard[l] = dot(lane.stress_hard, e);
  }
  along_.stress_before = stress_old_;
}

void ScalarStep::turn(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial,
                      TileOutputs& outputs) const {
  const TileLayout& layout = problem.layout;
  const bool forced = problem.options.strategy == Strategy::kForceDriven;
  for (const int l : lanes_of(inputs.active)) {
    const LaneVectors lane = vectors_of(layout, inputs, committed, l);
    const Vector e{first_[l], second_[l]};
    Vector stress = outputs.shear_stress[l] * e;
    Vector slip = outputs.sliding_velocity[l] * e;
    Vector jump_new = forced ? outputs.velocity_jump_new[l] * e : lane.jump;
    if ((outputs.outcome[l] & kFailed) != 0) {  // a node whose step failed keeps its old stress and jump
      stress = lane.stress_old;
      jump_new = lane.jump;
    } else if (outputs.regime[l] == Regime::kOpen) {
      slip = 0.5 * (lane.jump + jump_new);  // an open contact slips by the mean jump, which need not lie along e
    } else if (!forced) {
      const double apart = length(slip + -1.0 * lane.jump);
      outputs.outcome[l] &= static_cast<std::uint8_t>(~kOutsideDomain);
      if (!(apart <= kOutsideDomainShare * length(lane.jump))) outputs.outcome[l] |= kOutsideDomain;
    }
    if (inputs.wants_mean_stress) {
      // The part of the old stress across e ends at 0, along a straight path.
      const Vector across = lane.stress_old + -stress_old_[l] * e;
      const bool failed = (outputs.outcome[l] & kFailed) != 0, open = outputs.regime[l] == Regime::kOpen;
      const Vector mean = failed ? lane.stress_old : open ? Vector{} : outputs.mean_shear_stress[l] * e + 0.5 * across;
      outputs.mean_shear_stress[l] = mean.first;
      outputs.second_mean_shear_stress[l] = mean.second;
    }
    trial[layout.shear_stress + l] = outputs.shear_stress[l] = stress.first;
    trial[layout.second_stress + l] = outputs.second_shear_stress[l] = stress.second;
    outputs.sliding_velocity[l] = slip.first;
    outputs.second_sliding_velocity[l] = slip.second;
    outputs.velocity_jump_new[l] = jump_new.first;
    outputs.second_velocity_jump_new[l] = jump_new.second;
  }
}

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
