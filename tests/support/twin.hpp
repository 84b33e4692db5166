// Comparison of a step of the fast solvers with the same step of the reference twin, the slow scalar solver in
// server/physics/reference.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/interface/stress_limit.hpp"
#include "tests/support/invariants.hpp"

namespace shearbus::testing {

// The largest differences between a fast solver and the reference twin (the slow scalar solver) in a run.
struct Worst {
  double stress = 0.0, temperature = 0.0, slip = 0.0;
  int shapes = 0;  // number of compared heat_shape values whose tolerance is below 1e-4
};

// Returns the relative difference of stress to expect between a fast solver and the reference solver. The reference
// solver bisects to the last bit. Newton's method of the velocity-driven solver ends with a step of at most 1e-10 of
// the stress, which may cross the kink of the balance at which a vertex begins to flow. In addition an error of one ulp
// of T0 changes the stress, by a factor that grows with the steepness of thermal softening.
inline double resolution(const ModelOptions& options, const Material& m, double pressure, double T0) {
  const Softening soften = softening(m, pressure, T0);
  if (soften.g == 0.0) return 1.0;
  double steepness = std::abs(soften.slope) / (std::max(soften.g, 1e-300) * flow_exponent(m));
  if (has_friction(options) && properties_of(options.interface.friction_law).depends_on_temperature) {
    const StressLimit limit = interface_strength(options.interface, m, pressure, nullptr);
    const StressLimit::Value friction = limit.friction(T0);
    steepness = std::max(steepness, std::abs(friction.slope) / std::max(friction.stress, 1e-300));
  }
  return 5e-10 + 4e-13 * steepness * T0;
}

inline void require_agreement(const Rig& rig, const std::vector<double>& ep_old, const reference::NodeOutputs& twin,
                              const reference::NodeState& twin_state, int l, double dt, Worst& worst) {
  const TileOutputs& out = rig.outputs;
  const Material soft = at_pressure(rig.model.options().soft, rig.inputs.pressure[l]);
  const double T_hottest = *std::max_element(twin_state.temperature.begin(), twin_state.temperature.end());
  const double eps = resolution(rig.model.options(), soft, rig.inputs.pressure[l], T_hottest);
  const bool flows = rig.model.layout().plastic_strain != TileLayout::kAbsent;
  const double s = std::abs(twin.shear_stress);
  require_near(out.shear_stress[l], twin.shear_stress, eps * s + 1e-6, "s");
  require_near(out.interface_temperature[l], twin.interface_temperature, 1e-9, "T0");
  const double size = std::abs(rig.inputs.velocity_jump[l]) + std::abs(twin.sliding_velocity) +
                      rig.model.options().grid.thickness * std::abs(rig.inputs.soft_shear_rate[l]) +
                      rig.model.options().grid.thickness * s / (soft.shear_modulus * dt);
  // The reference twin evaluates DLP (48) as printed, with differences of plastic strains. The rounding error of these
  // strains, times the thickness over dt, is an error of the slip velocity.
  double strain = strain_scale(soft);
  for (double ep : twin_state.plastic_strain) strain = std::max(strain, ep);
  double noise = 1e-14 * strain * rig.model.options().grid.thickness / (dt * flow_exponent(soft));
  if (flows) noise += kSqrt3 * flow_grain(rig, ep_old, rig.stress(l), l, dt) / dt;
  require_near(out.sliding_velocity[l], twin.sliding_velocity, (1e-8 + eps) * size + noise, "[v]");
  const double shear = kSqrt3 * rig.model.options().grid.thickness * std::abs(rig.inputs.soft_plastic_strain_rate[l]);
  const double driven = dt * (std::abs(rig.inputs.stress_soft[l]) / rig.inputs.mass_soft[l] +
                              std::abs(rig.inputs.stress_hard[l]) / rig.inputs.mass_hard[l]);
  require_near(
      out.velocity_jump_new[l], twin.velocity_jump_new,
      1e-9 * (std::abs(twin.velocity_jump_new) + std::abs(rig.inputs.velocity_jump[l])) + 1e-12 * (driven + shear),
      "[V]");
  require_near(out.friction_heat[l], twin.friction_heat, eps * twin.friction_heat + 1e-9, "friction heat");
  if (rig.model.layout().num_friction_states > 0) {
    const double scale = std::max({1.0, std::abs(twin_state.friction_state), std::abs(rig.inputs.pressure[l])});
    const bool of_pressure = rig.model.options().interface.friction_law == FrictionLaws::place<PrakashClifton>();
    require_near(rig.friction_state(l), twin_state.friction_state, (1e-9 + eps) * (of_pressure ? scale : 1.0),
                 "state of friction");
  }
  if (rig.model.options().junctions) {
    const double slipped = dt * ((1e-8 + eps) * size + noise) / (kSqrt3 * rig.model.options().junctions->height);
    require_near(rig.junction_strain(l), twin_state.junction_strain, slipped + 1e-12 * twin_state.junction_strain,
                 "strain of the junctions");
  }
  require(((out.outcome[l] & kFirstOrder) != 0) == twin.first_order, "the order of the step differs");
  // Rate-and-state friction vanishes at rest: where a flowing layer takes nearly all slip, digits tell whether it slips.
  const bool creeps = rig.model.options().strategy == Strategy::kVelocityDriven && has_friction(rig.model.options()) &&
                      rig.model.options().interface.friction_law == FrictionLaws::place<RateAndState>() &&
                      twin.interface_slip <= (1e-7 + eps) * size + noise;
  if (!creeps && (std::abs(twin.sliding_velocity) > noise || twin.regime == Regime::kOpen)) {
    require(out.regime[l] == twin.regime, "regime {} instead of {}, T0 {:.17g}", static_cast<int>(out.regime[l]),
            static_cast<int>(twin.regime), twin.interface_temperature);
  }
  for (std::size_t i = 0; i < rig.model.layout().num_vertices; ++i) {
    require_near(rig.T(static_cast<int>(i), l), twin_state.temperature[i], 1e-9, "T of the soft body");
  }
  for (std::size_t i = 0; i < twin_state.liquid_fraction.size(); ++i)
    require_near(rig.liquid(static_cast<int>(i), l), twin_state.liquid_fraction[i], 1e-9, "liquid fraction");
  // Tolerance of heat_shape values: each is a ratio of strain increments of the step and has their relative error,
  // which is largest at the hottest vertex.
  double shaped = std::abs(twin.sliding_velocity);  // force-driven the shape is that of the flow of the layer alone
  if (rig.model.options().strategy == Strategy::kForceDriven) {
    shaped = 0.0;
    for (std::size_t i = 0; i < twin_state.heat_shape.size(); ++i)
      shaped += kSqrt3 * rig.model.grid().weight[i] * (twin_state.plastic_strain[i] - ep_old[i]) / dt;
  }
  const double share_noise = 1e-6 + (100.0 * noise + 1e-9 * size) / shaped +
                             1e3 * resolution(rig.model.options(), soft, rig.inputs.pressure[l], T_hottest);
  for (std::size_t i = 0; i < twin_state.heat_shape.size() && shaped != 0.0; ++i) {
    require_near(rig.heat_shape(static_cast<int>(i), l), twin_state.heat_shape[i], share_noise, "heat shape");
    if (share_noise < 1e-4) ++worst.shapes;
  }
  const int num_hard = static_cast<int>(rig.model.layout().num_hard_vertices);
  for (int i = 0; i < num_hard; ++i) {
    require_near(rig.T(i - num_hard, l), twin_state.hard_temperature[static_cast<std::size_t>(i)], 1e-9,
                 "T of the hard body");
  }
  if (s > 0.0) worst.stress = std::max(worst.stress, std::abs(out.shear_stress[l] / twin.shear_stress - 1.0));
  worst.temperature = std::max(worst.temperature, std::abs(out.interface_temperature[l] - twin.interface_temperature));
  if (size > noise) worst.slip = std::max(worst.slip, std::abs(out.sliding_velocity[l] - twin.sliding_velocity) / size);
}

}  // namespace shearbus::testing
