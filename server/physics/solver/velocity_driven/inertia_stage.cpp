#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

#include <algorithm>
#include <cstddef>

#include "server/physics/solver/velocity_driven/forced_stage.hpp"
#include "server/physics/solver/velocity_driven/wave_contacts.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// Newton steps of the kernel in a search for the stress of the contact, which tries stresses far from the last answer.
constexpr int kStepsOfSearch = 25;

// Share of the work of s(0) on the jump that waves turn into heat at z = 0: under force only slip heats.
double wave_heat_share(const Problem& problem) {
  return is_forced(problem) ? 0.0 : heat_share(problem);
}

}  // namespace

std::uint32_t solve_waves(const InertiaStage& stage, const WaveEnds& ends, std::uint32_t lanes,
                          const double (&limit)[kLanes]) {
  if (lanes == 0) return 0;
  const auto& [problem, heat, inputs, contacts, trial, found, guess] = stage;
  const TileLayout& layout = problem.layout;
  const int n = problem.grid.num_cells();
  const Material& soft = problem.options.soft;
  WaveStep step{.soft = &soft,
                .grid = &problem.grid,
                .response = heat.layer_response(),
                .dt = heat.dt,
                .heat_share = wave_heat_share(problem),
                .T_ad = trial + layout.temperature,
                .strain = trial + layout.plastic_strain,
                .stress = trial + layout.shear_stress,
                .velocity = trial + layout.layer_velocity,
                .guess = guess,
                .tries_limit = guess != nullptr,
                .forced = is_forced(problem),
                .heats_in_place = problem.options.taylor_quinney_factor.has_value()};
  if (guess != nullptr) step.most_steps = kStepsOfSearch;
  std::copy_n(ends.give_near, kLanes, step.give_near);
  std::copy_n(ends.give_far, kLanes, step.give_far);
  for (const int l : lanes_of(lanes)) {
    step.pressure[l] = inputs.pressure[l];
    step.jump[l] = ends.jump[l];
    step.coulomb[l] = limit[l];
  }
  WaveAnswer answer;
  const std::uint32_t solved = advance_waves(step, lanes, answer);
  for (const int l : lanes_of(lanes)) {
    if (inputs.effort != nullptr) {
      inputs.effort->wave_evaluations += static_cast<int>(answer.evaluations[l]);
    }
    add_work(inputs, l, n * (1.0 + flow_work(soft.flow_law) * answer.evaluations[l]));
    if (!contains(solved, l)) continue;
    const double* stress = trial + layout.shear_stress + l;
    found[l] = {.flux = answer.flux[l],
                .slip_along = {answer.slip_along[0][l], answer.slip_along[1][l]},
                .interface_slip = answer.interface_slip[l],
                .interface_slips = answer.interface_slip[l] != 0.0,
                .stress = {stress[0], stress[std::ptrdiff_t{n} * kLanes]}};
    add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux[l], trial + layout.first_temperature());
  }
  return lanes & ~solved;
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
