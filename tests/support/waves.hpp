// Stress, velocity and temperature fields of one lane of a layer with inertia, and a step of these fields without the
// rest of the model.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "server/physics/solver/velocity_driven/waves.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

inline ModelOptions with_inertia(ModelOptions options) {
  options.inertia = true;
  return options;
}

inline ModelOptions of_first_order(ModelOptions options) {
  options.time_integrator = TimeIntegrator::kBackwardEuler;
  return options;
}
inline ModelOptions of_second_order(ModelOptions options) {
  options.time_integrator = TimeIntegrator::kSdirk2;
  return options;
}

inline double shear_speed(const Material& m) {
  return std::sqrt(m.shear_modulus / m.density);
}
inline double impedance(const Material& m) {
  return std::sqrt(m.shear_modulus * m.density);
}

inline double stress_at(const Rig& rig, int vertex, int lane = 0) {
  return rig.committed[rig.model.layout().shear_stress + std::size_t(vertex) * kLanes + std::size_t(lane)];
}
inline double velocity_in(const Rig& rig, int cell, int lane = 0) {
  return rig.committed[rig.model.layout().layer_velocity + std::size_t(cell) * kLanes + std::size_t(lane)];
}

inline WaveStep wave_step(const Rig& rig, int lane, const HeatOperator& heat, const Material& soft_at_pressure) {
  const ModelOptions& o = rig.model.options();
  const double pressure = rig.inputs.pressure[lane];
  return {
      .soft = &soft_at_pressure,
      .grid = &rig.model.grid(),
      .response = heat.layer_response(),
      .dt = heat.dt,
      .pressure = pressure,
      .jump = rig.inputs.velocity_jump[lane],
      .heat_share = rig.conducted_share(),
      .coulomb = o.friction_coefficient ? *o.friction_coefficient * pressure : std::numeric_limits<double>::infinity()};
}

// Computes the fields from which the next step of a lane, of the length of `heat`, starts. The temperatures include the
// conduction of that step.
inline void fill_fields(const Rig& rig, int lane, const HeatOperator& heat, WaveFields& fields) {
  const HeatGrid& grid = rig.heat_grid();
  std::vector<double> T(rig.committed.size());
  const std::size_t first = rig.model.layout().first_temperature();
  conduct(heat, grid.num_vertices(), rig.committed.data() + first, T.data());
  const bool was_open = rig.committed[rig.model.layout().regime + lane] == static_cast<double>(Regime::kOpen);
  const int n = rig.model.grid().num_cells();
  for (int i = 0; i <= n; ++i) {
    fields.T_ad[i] = T[(std::size_t(grid.interface) + std::size_t(i)) * kLanes + std::size_t(lane)];
    fields.strain[i] = rig.ep(i, lane);
    fields.stress[i] = stress_at(rig, i, lane);
    if (i < n) fields.velocity[i] = was_open ? rig.inputs.velocity_jump[lane] : velocity_in(rig, i, lane);
  }
}

}  // namespace shearbus::testing
