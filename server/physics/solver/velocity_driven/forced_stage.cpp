#include "server/physics/solver/velocity_driven/forced_stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/solver/velocity_driven/wave_contacts.hpp"

namespace shearbus::physics {
namespace {

// Mass per area of the layer  [kg/m2].
double mass_of_layer(const Problem& problem) {
  return problem.options.soft.density * problem.grid.vertex.back();
}

// Mass per area of the host's soft half zone behind the layer  [kg/m2].
double mass_behind_layer(const Problem& problem, double mass_soft) {
  return mass_soft - mass_of_layer(problem);
}

}  // namespace

LeastMasses least_masses(const Problem& problem, double dt) {
  constexpr double kMostSwing = 1e10;  // G0 dt^2/(weight m)
  const double rigid = problem.options.soft.shear_modulus * dt * (dt / kMostSwing);
  return {mass_of_layer(problem) + rigid / problem.grid.weight.back(), rigid / problem.grid.weight.front()};
}

LeastMasses Model::least_masses(double dt) const {
  return physics::least_masses(*problem_, dt);
}

void follow_host(const Problem& problem, const TileInputs& inputs, double* trial) {
  const TileLayout& layout = problem.layout;
  const std::size_t n = layout.num_velocity_cells - 1;
  for (const int l : lanes_of(inputs.active)) {
    double* velocity = trial + layout.layer_velocity + static_cast<std::size_t>(l);
    const double jump = inputs.velocity_jump[l];
    double ahead = mass_behind_layer(problem, inputs.mass_soft[l]) * (velocity[n * kLanes] - jump);
    for (std::size_t c = 0; c < n; ++c)
      ahead += problem.options.soft.density * problem.grid.width[c] * (velocity[c * kLanes] - jump);
    for (std::size_t c = 0; c <= n; ++c) velocity[c * kLanes] -= ahead / inputs.mass_soft[l];
  }
}

std::uint32_t meet_bodies(const InertiaStage& stage, std::uint32_t lanes, WaveEnds& ends) {
  const Problem& problem = stage.problem;
  const TileInputs& inputs = stage.inputs;
  double* trial = stage.trial;
  std::copy_n(inputs.velocity_jump, kLanes, ends.jump);
  std::fill_n(ends.give_near, kLanes, 1.0);
  std::fill_n(ends.give_far, kLanes, 1.0);
  if (!is_forced(problem)) return 0;
  const double dt = stage.heat.dt;
  const std::size_t n = problem.layout.num_stress_vertices - 1;
  const LeastMasses least = least_masses(problem, dt);
  std::uint32_t lost = 0;
  for (const int l : lanes_of(lanes)) {
    const auto lane = static_cast<std::size_t>(l);
    if (!(inputs.mass_soft[l] > least.soft && inputs.mass_hard[l] > least.hard)) {
      lost |= 1u << l;
      continue;
    }
    // The stress before the stage and the host's force, each with its share of the trial stress.
    const auto meet = [&](std::size_t vertex, double of_body, double force) {
      const double follows = problem.options.soft.shear_modulus * dt / problem.grid.weight[vertex] * (dt / of_body);
      double& stress = trial[problem.layout.shear_stress + vertex * kLanes + lane];
      stress = stress / (1.0 + follows) + force * (follows / (1.0 + follows));
      return 1.0 + follows;
    };
    ends.give_near[l] = meet(0, inputs.mass_hard[l], inputs.stress_hard[l]);
    ends.give_far[l] = meet(n, mass_behind_layer(problem, inputs.mass_soft[l]), inputs.stress_soft[l]);
    ends.jump[l] = trial[problem.layout.layer_velocity + n * kLanes + lane] + (*stage.contacts)[l].drive;
  }
  return lost;
}

void leave_bodies(const InertiaStage& stage, std::uint32_t lanes) {
  const auto& [problem, heat, inputs, contacts, trial, found, guess] = stage;
  if (!is_forced(problem)) return;
  const std::size_t n = problem.layout.num_stress_vertices - 1;
  for (const int l : lanes_of(lanes)) {
    double* stress = trial + problem.layout.shear_stress + static_cast<std::size_t>(l);
    double* velocity = trial + problem.layout.layer_velocity + static_cast<std::size_t>(l);
    velocity[n * kLanes] +=
        (inputs.stress_soft[l] - stress[n * kLanes]) * (heat.dt / mass_behind_layer(problem, inputs.mass_soft[l]));
    const double hard = (stress[0] - inputs.stress_hard[l]) * (heat.dt / inputs.mass_hard[l]);
    for (std::size_t c = 0; c <= n; ++c) velocity[c * kLanes] -= hard;
    found[l].mean_slip = found[l].interface_slip;
  }
}

}  // namespace shearbus::physics
