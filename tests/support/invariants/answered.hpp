// Inputs and answer of one node in one step: the quantities to which the checks of the invariants apply.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/support/invariants/figures.hpp"

namespace shearbus::testing {

// Upper bound of the number of substeps of any step. Without a tolerance a step has at most 64 substeps.
inline constexpr int kMostParts = 1 << 22;

// Inputs and answer of one node in one step, projected on the direction of the answer. The struct does not name the
// solver, so that the same checks apply to correct models and to deliberately wrong solvers.
struct Answered {
  double dt = 0.0;        // step length [s]
  double pressure = 0.0;  // compression of the contact [Pa]
  double jump_old = 0.0, jump_new = 0.0, slip = 0.0;
  // length of the vector [V] before the projection; its last digit limits the accuracy of the projected values  [m/s]
  double jump_length = 0.0;
  double stress_old = 0.0, stress = 0.0;
  double T0 = 0.0, heat = 0.0;
  // change of the velocity jump by the stresses of both bodies far from the interface, DLP (61)  [m/s]
  double driven = 0.0;
  double driven_size = 0.0;  // the same change with absolute values: dt (|s_soft|/m_soft + |s_hard|/m_hard)  [m/s]
  double per_stress = 0.0;   // decrease of the jump per unit interface stress, dt (1/m_soft + 1/m_hard)  [m/(s Pa)]
  // slip velocity from the plastic strain rate Ep_dot of the host's zone, sqrt(3) h Ep_dot with the layer thickness h,
  // and the length of its vector  [m/s]
  double plastic_drive = 0.0, plastic_drive_size = 0.0;
  double junction_strain = 0.0;
  double friction_state = 0.0;  // state of the friction law before the step
  bool sticks = false;  // the interface sticks at the end of the step; set only for a model with a plastic layer
  Regime regime = Regime::kOpen;
  std::uint8_t outcome = 0;
  bool controlled = false;  // the model has a tolerance, so that any step may consist of substeps

  bool divided() const { return (outcome & kSubstepped) != 0; }
  // Upper bound of the number of substeps of this step. If the bound is above 1, the answer consists of means, sums and
  // final values of the substeps.
  int parts() const { return divided() || controlled ? kMostParts : 1; }
  bool in_parts() const { return parts() > 1; }
  double size() const { return std::abs(jump_old) + plastic_drive_size + driven_size + std::abs(stress * per_stress); }
};

// Reads one lane of a rig after a step, when rig.trial holds the state before the step. A vector with two components is
// projected on the direction of the answered stress; if the stress is 0, on that of the slip, or else of the new jump.
inline Answered answered(const Rig& rig, int lane, double dt) {
  const TileInputs& in = rig.inputs;
  const TileOutputs& out = rig.outputs;
  const TileLayout& layout = rig.model.layout();
  double x = 1.0, y = 0.0;
  if (rig.model.options().tangential_components == 2) {
    const auto along = [&](double first, double second) {
      const double largest = std::max(std::abs(first), std::abs(second));
      if (!(largest > 0.0)) return false;
      const double length = std::hypot(first / largest, second / largest);
      x = first / largest / length;
      y = second / largest / length;
      return true;
    };
    along(out.shear_stress[lane], rig.outputs.second_shear_stress[lane]) ||
        along(out.sliding_velocity[lane], rig.outputs.second_sliding_velocity[lane]) ||
        along(out.velocity_jump_new[lane], rig.outputs.second_velocity_jump_new[lane]);
  }
  const auto project = [&](double first, double second) { return y == 0.0 ? first * x : first * x + second * y; };
  Answered a;
  a.dt = dt;
  a.pressure = in.pressure[lane];
  a.jump_old = project(in.velocity_jump[lane], rig.inputs.second_velocity_jump[lane]);
  a.jump_length = std::hypot(in.velocity_jump[lane], rig.inputs.second_velocity_jump[lane]);
  a.jump_new = project(out.velocity_jump_new[lane], rig.outputs.second_velocity_jump_new[lane]);
  a.slip = project(out.sliding_velocity[lane], rig.outputs.second_sliding_velocity[lane]);
  a.stress = project(out.shear_stress[lane], rig.outputs.second_shear_stress[lane]);
  a.stress_old = project(rig.trial[layout.shear_stress + lane],
                         layout.second_stress == TileLayout::kAbsent ? 0.0 : rig.trial[layout.second_stress + lane]);
  a.T0 = out.interface_temperature[lane];
  a.heat = out.friction_heat[lane];
  const double minus = project(in.stress_soft[lane], rig.inputs.second_stress_soft[lane]) / in.mass_soft[lane];
  const double plus = project(in.stress_hard[lane], rig.inputs.second_stress_hard[lane]) / in.mass_hard[lane];
  a.driven = dt * (minus + plus);
  a.driven_size = dt * (std::abs(minus) + std::abs(plus));
  a.per_stress = dt * (1 / in.mass_soft[lane] + 1 / in.mass_hard[lane]);
  if (rig.model.options().plastic_layer) {
    const double per_rate = kSqrt3 * rig.model.options().grid.thickness;
    a.plastic_drive = per_rate * project(in.soft_plastic_strain_rate[lane], in.second_soft_plastic_strain_rate[lane]);
    a.plastic_drive_size =
        per_rate * std::hypot(in.soft_plastic_strain_rate[lane], in.second_soft_plastic_strain_rate[lane]);
  }
  if (layout.junction_strain != TileLayout::kAbsent) a.junction_strain = rig.junction_strain(lane);
  if (layout.num_friction_states > 0) a.friction_state = rig.trial[layout.friction_state + lane];
  if (layout.sticking != TileLayout::kAbsent) a.sticks = rig.committed[layout.sticking + lane] != 0.0;
  a.regime = out.regime[lane];
  a.outcome = out.outcome[lane];
  a.controlled = rig.model.options().tolerance.has_value();
  return a;
}

// absolute tolerance in comparisons of products of denormal numbers
inline constexpr double kProductOfDenormals = 1e-290;

// error of the temperatures of a sleeping node, which keeps its heat in modes [K]
inline constexpr double kSleeperGrain = 1e-9;

}  // namespace shearbus::testing
