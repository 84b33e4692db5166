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

// The fields of one node, with a value per cell for the velocity and per vertex for the others.
struct WaveFields {
  using Row = double[kMaxInertiaCells + 1];
  Row T_ad;           // temperature after the step without friction  [K]
  Row strain;         // plastic strain ep before the step
  Row stress;         // stress s before or after the step  [Pa]
  Row velocity;       // velocity v before or after the step  [m/s]
  Row strain_growth;  // growth of the plastic strain in the step, dep
};

// A step of these fields.
struct LaneWaves {
  const Material* soft;  // at the pressure of the node
  const Grid* grid;
  const double* response;
  double dt, pressure, jump, heat_share, coulomb;
};
struct LaneAnswer {
  double flux = 0.0, interface_slip = 0.0;
  int iterations = 0;
  bool guarded = false, found = true;
};

inline LaneWaves lane_waves(const Rig& rig, int lane, const HeatOperator& heat, const Material& soft_at_pressure) {
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

// The step by the search of one lane; without Newton steps by its guarded search.
inline LaneAnswer search_waves(const Rig& rig, const LaneWaves& of, int newton_steps, WaveFields& fields) {
  const int n = of.grid->num_cells();
  const auto rows = static_cast<std::size_t>(n + 1) * kLanes;
  std::vector<double> T_ad(rows), strain(rows), stress(rows), velocity(rows);
  for (int i = 0; i <= n; ++i) {
    const auto at = static_cast<std::size_t>(i) * kLanes;
    T_ad[at] = fields.T_ad[i];
    strain[at] = fields.strain[i];
    stress[at] = fields.stress[i];
    if (i < n) velocity[at] = fields.velocity[i];
  }
  WaveStep step{.soft = &rig.model.options().soft,
                .grid = of.grid,
                .response = of.response,
                .dt = of.dt,
                .heat_share = of.heat_share,
                .pressure = {of.pressure},
                .jump = {of.jump},
                .coulomb = {of.coulomb},
                .give_near = {1.0},
                .give_far = {1.0},
                .T_ad = T_ad.data(),
                .strain = strain.data(),
                .stress = stress.data(),
                .velocity = velocity.data(),
                .most_steps = 0,
                .most_steps_alone = newton_steps};
  WaveAnswer answer;
  LaneAnswer found{.found = advance_waves(step, 1, answer) == 1};
  found.guarded = answer.guarded != 0;
  found.iterations = static_cast<int>(answer.evaluations[0]);
  if (!found.found) return found;
  found.flux = answer.flux[0];
  found.interface_slip = answer.interface_slip[0];
  for (int i = 0; i <= n; ++i) {
    const auto at = static_cast<std::size_t>(i) * kLanes;
    fields.strain_growth[i] = strain[at] - fields.strain[i];
    fields.stress[i] = stress[at];
    if (i < n) fields.velocity[i] = velocity[at];
  }
  return found;
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
