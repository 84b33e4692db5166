#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/velocity_driven/forced_stage.hpp"
#include "server/physics/solver/velocity_driven/wave_contacts.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/velocity_driven/waves_wide.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// Newton steps of the kernel in a search for the stress of the contact, which tries stresses far from the last answer.
constexpr int kStepsOfSearch = 25;

void gather(const double* rows, int count, double* values) {
  for (std::ptrdiff_t i = 0; i < count; ++i) values[i] = rows[i * kLanes];
}

void scatter(const double* values, int count, double* rows) {
  for (std::ptrdiff_t i = 0; i < count; ++i) rows[i * kLanes] = values[i];
}

// Share of the work of s(0) on the jump that waves turn into heat at z = 0: under force only slip heats.
double wave_heat_share(const Problem& problem) {
  return is_forced(problem) ? 0.0 : heat_share(problem);
}

// Solves the waves of one lane. Returns false if no answer was found.
bool search_lane(const InertiaStage& stage, const WaveEnds& ends, double limit, int l) {
  const auto& [problem, heat, inputs, contacts, trial, all_found, guess] = stage;
  Found& found = all_found[l];
  const TileLayout& layout = problem.layout;
  const Grid& grid = problem.grid;
  const int n = grid.num_cells();
  const Material soft = at_pressure(problem.options.soft, inputs.pressure[l]);
  const WaveStep step{.soft = &soft,
                      .grid = &grid,
                      .response = heat.layer_response(),
                      .dt = heat.dt,
                      .pressure = inputs.pressure[l],
                      .jump = ends.jump[l],
                      .heat_share = wave_heat_share(problem),
                      .coulomb = limit,
                      .give_near = ends.give_near[l],
                      .give_far = ends.give_far[l],
                      .forced = is_forced(problem)};
  WaveFields fields;
  gather(trial + layout.temperature + l, n + 1, fields.T_ad);
  gather(trial + layout.plastic_strain + l, n + 1, fields.strain);
  gather(trial + layout.shear_stress + l, n + 1, fields.stress);
  gather(trial + layout.layer_velocity + l, n, fields.velocity);

  if (guess != nullptr) gather(guess + l, n, fields.guess);
  fields.has_guess = guess != nullptr;
  const WaveAnswer answer = advance_waves(step, fields);
  if (inputs.effort != nullptr) {
    inputs.effort->newton_steps += answer.iterations;
    inputs.effort->guarded_steps += answer.guarded ? 1 : 0;
  }
  add_work(inputs, l, n * (1.0 + flow_work(soft.flow_law) * answer.iterations));
  if (!answer.found) return false;

  // A vertex flows in the direction of its stress. A stress that has fallen to 0 keeps its sign as +0 or -0.
  found = {.flux = answer.flux,
           .interface_slip = answer.interface_slip,
           .interface_slips = answer.interface_slip != 0.0,
           .stress = {fields.stress[0], fields.stress[n]}};
  found.slip_along[std::signbit(fields.stress[0])] = std::abs(answer.interface_slip) * step.dt;
  for (int i = 0; i <= n; ++i) {
    found.slip_along[std::signbit(fields.stress[i])] += kSqrt3 * grid.weight[i] * fields.strain_growth[i];
    fields.strain[i] += fields.strain_growth[i];
  }
  scatter(fields.strain, n + 1, trial + layout.plastic_strain + l);
  scatter(fields.stress, n + 1, trial + layout.shear_stress + l);
  scatter(fields.velocity, n, trial + layout.layer_velocity + l);
  add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux, trial + layout.first_temperature());
  return true;
}

}  // namespace

// By Newton's method in all lanes at once, and by search_lane() where that has not found an answer.
std::uint32_t solve_waves(const InertiaStage& stage, const WaveEnds& ends, std::uint32_t lanes,
                          const double (&limit)[kLanes]) {
  if (lanes == 0) return 0;
  const auto& [problem, heat, inputs, contacts, trial, found, guess] = stage;
  const TileLayout& layout = problem.layout;
  const int n = problem.grid.num_cells();
  const Material& any = problem.options.soft;
  if (!properties_of(any.flow_law).has_wave_return) {
    std::uint32_t unsolved = 0;
    for (const int l : lanes_of(lanes))
      if (!search_lane(stage, ends, limit[l], l)) unsolved |= 1u << l;
    return unsolved;
  }
  WideWaveStep step{.soft = &any,
                    .grid = &problem.grid,
                    .response = heat.layer_response(),
                    .dt = heat.dt,
                    .heat_share = wave_heat_share(problem),
                    .T_ad = trial + layout.temperature,
                    .strain = trial + layout.plastic_strain,
                    .stress = trial + layout.shear_stress,
                    .velocity = trial + layout.layer_velocity,
                    .guess = guess,
                    .most_steps = guess != nullptr ? kStepsOfSearch : WideWaveStep{}.most_steps,
                    .tries_limit = guess != nullptr};
  std::copy_n(ends.give_near, kLanes, step.give_near);
  std::copy_n(ends.give_far, kLanes, step.give_far);
  for (const int l : lanes_of(lanes)) {
    const Material soft = at_pressure(any, inputs.pressure[l]);
    step.T_melt[l] = soft.melting_temperature;
    step.bracket[l] = SteinbergCochranGuinan::bracket_at(soft, inputs.pressure[l]);
    step.jump[l] = ends.jump[l];
    step.coulomb[l] = limit[l];
  }
  WideWaveAnswer answer;
  const std::uint32_t solved = advance_waves_wide(step, lanes, answer);
  std::uint32_t lost = 0;
  for (const int l : lanes_of(lanes)) {
    if (!contains(solved, l)) {
      if (!search_lane(stage, ends, limit[l], l)) lost |= 1u << l;
      continue;
    }
    if (inputs.effort != nullptr) inputs.effort->newton_steps += static_cast<int>(answer.iterations[l]);
    add_work(inputs, l, n * (1.0 + answer.iterations[l]));
    const double* stress = trial + layout.shear_stress + l;
    found[l] = {.flux = answer.flux[l],
                .slip_along = {answer.slip_along[0][l], answer.slip_along[1][l]},
                .interface_slip = std::copysign(answer.interface_slip[l], stress[0]),
                .interface_slips = answer.interface_slip[l] != 0.0,
                .stress = {stress[0], stress[std::ptrdiff_t{n} * kLanes]}};
    found[l].slip_along[std::signbit(stress[0])] += answer.interface_slip[l] * heat.dt;
    add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux[l], trial + layout.first_temperature());
  }
  return lost;
}

std::uint32_t solve_stage(const InertiaStage& stage, std::uint32_t lanes) {
  if (lanes == 0) return 0;
  const Problem& problem = stage.problem;
  WaveEnds ends;
  std::uint32_t lost = meet_bodies(stage, lanes, ends);
  if (stage.contacts != nullptr) {
    lost |= solve_contacts(stage, ends, lanes & ~lost);
  } else {
    double limit[kLanes];
    for (const int l : lanes_of(lanes))
      limit[l] = interface_strength(problem.interface, problem.options.soft, stage.inputs.pressure[l], nullptr).coulomb;
    lost |= solve_waves(stage, ends, lanes, limit);
  }
  leave_bodies(stage, lanes & ~lost);
  return lost;
}

}  // namespace shearbus::physics
