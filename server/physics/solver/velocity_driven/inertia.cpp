#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/velocity_driven/forced_stage.hpp"
#include "server/physics/solver/velocity_driven/wave_contacts.hpp"
#include "server/physics/solver/velocity_driven/waves_heat.hpp"

namespace shearbus::physics {
namespace {

// The step of two stages of SDIRK2. Slip takes the weight that extrapolates the first stage to the start of the second.
Found step_of(const Found& first, const Found& second) {
  const auto slip = [&](int k) { return sdirk2::kExtrapolation * first.slip_along[k] + second.slip_along[k]; };
  const auto mean = [](double one, double two) { return sdirk2::kFirstWeight * one + sdirk2::kDiagonal * two; };
  return {.flux = mean(first.flux, second.flux),
          .slip_along = {slip(0), slip(1)},
          .interface_slip = second.interface_slip,
          .mean_slip = mean(first.interface_slip, second.interface_slip),
          .interface_slips = second.interface_slips,
          .several = first.several || second.several,
          .stress = {mean(first.stress[0], second.stress[0]), mean(first.stress[1], second.stress[1])}};
}

// An open contact: the layer moves with the soft body without stress, until the contact closes.
void open_lane(const Problem& problem, double dt, const TileInputs& inputs, double* trial, int l,
               TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double jump = inputs.velocity_jump[l];
  const LaneStep open = is_forced(problem) ? open_step(forcing_of(inputs, l), dt, jump)
                                           : LaneStep{0.0, jump, jump, 0.0, Regime::kOpen, false, true, false};
  for (std::size_t i = 0; i < layout.num_stress_vertices; ++i) trial[layout.shear_stress + i * kLanes + l] = 0.0;
  for (std::size_t i = 0; i < layout.num_velocity_cells; ++i)
    trial[layout.layer_velocity + i * kLanes + l] = open.jump_new;
  write_answer({open}, layout, l, trial, outputs);
  if (inputs.wants_mean_stress) outputs.mean_shear_stress[l] = outputs.mean_far_stress[l] = 0.0;
}

// The mechanical state from which the step of the closed lanes starts. A contact that closes finds the layer moving with
// the soft body.
void copy_start(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial) {
  const TileLayout& layout = problem.layout;
  const auto copy_rows = [&](std::size_t first, std::size_t rows) {
    std::copy_n(committed + first, rows * kLanes, trial + first);
  };
  copy_rows(layout.plastic_strain, layout.num_strain_vertices);
  copy_rows(layout.shear_stress, layout.num_stress_vertices);
  copy_rows(layout.layer_velocity, layout.num_velocity_cells);
  if (layout.heat_shape != TileLayout::kAbsent) copy_rows(layout.heat_shape, layout.num_strain_vertices);
  for (const int l : lanes_of(inputs.active)) {
    if (committed[layout.regime + l] != static_cast<double>(Regime::kOpen)) continue;
    for (std::size_t i = 0; i < layout.num_velocity_cells; ++i)
      trial[layout.layer_velocity + i * kLanes + l] = inputs.velocity_jump[l];
  }
  if (is_forced(problem)) follow_host(problem, inputs, trial);
}

// The same force-driven: the stress is the mean that the host's balance of momentum needs, DLP (61).
void answer_forced(double dt, const TileInputs& inputs, const Found& found, int l, TileOutputs& outputs) {
  const Forcing forcing = forcing_of(inputs, l);
  outputs.shear_stress[l] = found.stress[0];
  outputs.sliding_velocity[l] = found.mean_slip;
  outputs.velocity_jump_new[l] =
      inputs.velocity_jump[l] + dt * forcing.acceleration - found.stress[0] * (dt * forcing.mobility);
  outputs.outcome[l] = 0;
}

// Writes the answer of a closed lane. [v] is the slip along s(0): what flows against s(0), because waves have turned the
// stress there, works against another stress than the interface's. Without stress at z = 0 it is the whole slip.
void answer_lane(const Problem& problem, double dt, const TileInputs& inputs, const Found& found, const double* trial,
                 int l, double hottest, TileOutputs& outputs) {
  const double stress = trial[problem.layout.shear_stress + l];
  const bool carries = std::abs(stress) >= kNoStress;
  const double slip = (carries && stress < 0.0 ? 0.0 : found.slip_along[0]) / dt -
                      (carries && stress > 0.0 ? 0.0 : found.slip_along[1]) / dt;
  outputs.shear_stress[l] = !carries && slip * stress < 0.0 ? 0.0 : stress;
  outputs.sliding_velocity[l] = slip;
  outputs.velocity_jump_new[l] = inputs.velocity_jump[l];
  outputs.friction_heat[l] = found.flux * dt;
  if (inputs.wants_mean_stress) {
    outputs.mean_shear_stress[l] = found.stress[0];
    outputs.mean_far_stress[l] = found.stress[1];
  }
  const bool moves =
      is_forced(problem) ? found.slip_along[0] + found.slip_along[1] > 0.0 || found.mean_slip != 0.0 : slip != 0.0;
  outputs.regime[l] = !moves ? Regime::kStick
                      : found.interface_slips
                          ? Regime::kCoulomb
                          : yielding_regime(at_pressure(problem.options.soft, inputs.pressure[l]), hottest);
  outputs.outcome[l] = outside_domain(slip, inputs.velocity_jump[l]);
  if (is_forced(problem)) answer_forced(dt, inputs, found, l, outputs);
  if (found.several) outputs.outcome[l] |= kMultipleRoots;
}

void answer_lanes(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes,
                  const Found (&found)[kLanes], const double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  double coldest[kLanes], hottest[kLanes];
  range_of_rows(static_cast<std::ptrdiff_t>(layout.num_strain_vertices), trial + layout.temperature, coldest, hottest);
  for (const int l : lanes_of(lanes)) answer_lane(problem, dt, inputs, found[l], trial, l, hottest[l], outputs);
}

// Writes what an answer of any regime has, and the regime into the state.
void close_lane(const Problem& problem, double* trial, int l, TileOutputs& outputs) {
  outputs.interface_temperature[l] = trial[problem.layout.temperature + l];
  trial[problem.layout.regime + l] = static_cast<double>(outputs.regime[l]);
}

// The states of the contact after the step, and the regime of an interface that slips where its junctions yield.
void close_contact(const Problem& problem, const WaveContacts::Lane& contact, const Found& found, double* trial, int l,
                   TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const bool open = outputs.regime[l] == Regime::kOpen;
  const double T0 = trial[layout.temperature + l];
  const double slip = std::abs(open ? outputs.sliding_velocity[l] : found.interface_slip);
  if (outputs.regime[l] == Regime::kCoulomb) outputs.regime[l] = slip_regime(contact.limit, T0, slip);
  ContactState state = contact.state;
  if (!advance_contact(contact.limit, slip, T0, state))  // the caller keeps the state of a lane with such an answer
    outputs.shear_stress[l] = std::numeric_limits<double>::quiet_NaN();
  store_contact(problem, state, trial, l);
  if (layout.sticking != TileLayout::kAbsent) trial[layout.sticking + l] = open || slip > 0.0 ? 0.0 : 1.0;
}

void close_lanes(const Problem& problem, std::uint32_t lanes, const WaveContacts* contacts,
                 const Found (&found)[kLanes], double* trial, TileOutputs& outputs) {
  for (const int l : lanes_of(lanes)) {
    if (contacts != nullptr) close_contact(problem, (*contacts)[l], found[l], trial, l, outputs);
    close_lane(problem, trial, l, outputs);
  }
}

// The contacts of the step; none where a constant friction stress limits the stress.
std::optional<WaveContacts> contacts_of(const Problem& problem, const StepOperators& operators,
                                        const TileInputs& inputs, const double* committed) {
  return WaveContacts::needed(problem)
             ? std::optional<WaveContacts>(std::in_place, problem, inputs, committed, operators.dt())
             : std::optional<WaveContacts>();
}

// Answers the lanes whose contact is open, and copies the state of the others from which the step starts. Returns the
// latter.
std::uint32_t start_lanes(const Problem& problem, double dt, const TileInputs& inputs, const double* committed,
                          double* trial, TileOutputs& outputs) {
  copy_start(problem, inputs, committed, trial);
  std::uint32_t closed = inputs.active;
  for (const int l : lanes_of(inputs.active)) {
    if (inputs.pressure[l] > 0.0) continue;
    open_lane(problem, dt, inputs, trial, l, outputs);
    closed &= ~(1u << l);
  }
  return closed;
}

// The start of the second stage of `lanes`: extrapolates the mechanical state, from the start of the step through the
// end of the first stage.
void extrapolate_lanes(const Problem& problem, const TileInputs& inputs, std::uint32_t lanes, const double* committed,
                       double* trial) {
  const TileLayout& layout = problem.layout;
  double* start = scratch_tile(Scratch::kStages, layout.doubles);
  copy_start(problem, inputs, committed, start);
  const auto extrapolate = [&](std::size_t first, std::size_t rows) {
    for (std::size_t row = first; row < first + rows * kLanes; row += kLanes)
      for (const int l : lanes_of(lanes))
        trial[row + l] = start[row + l] + sdirk2::kExtrapolation * (trial[row + l] - start[row + l]);
  };
  extrapolate(layout.plastic_strain, layout.num_strain_vertices);
  extrapolate(layout.shear_stress, layout.num_stress_vertices);
  extrapolate(layout.layer_velocity, layout.num_velocity_cells);
}

}  // namespace

void advance_with_inertia(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs) {
  const std::size_t T = problem.layout.first_temperature();
  conduct(operators.heat(), problem.heat_grid.num_vertices(), committed + T, trial + T);
  const std::uint32_t closed = start_lanes(problem, operators.dt(), inputs, committed, trial, outputs);
  const std::optional<WaveContacts> contacts = contacts_of(problem, operators, inputs, committed);
  Found found[kLanes];
  const WaveContacts* contact = contacts ? &*contacts : nullptr;
  const InertiaStage stage{problem, operators.heat(), inputs, contact, trial, found};
  const std::uint32_t lost = problem.options.taylor_quinney_factor
                                 ? solve_heated_stage(operators, stage, committed, closed)
                                 : solve_stage(stage, closed);
  answer_lanes(problem, operators.dt(), inputs, closed & ~lost, found, trial, outputs);
  close_lanes(problem, inputs.active & ~lost, contact, found, trial, outputs);
  for (const int l : lanes_of(lost)) keep_lane(problem, inputs, committed, trial, l, outputs);
}

void advance_with_inertia_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs) {
  const HeatOperator& stage = operators.stage();
  const int n = problem.heat_grid.num_vertices();
  const double* T_old = committed + problem.layout.first_temperature();
  double* T = trial + problem.layout.first_temperature();
  Found first[kLanes], second[kLanes];

  // 1. First stage of SDIRK2: backward Euler over gamma dt. `lost`: lanes for which this step has no answer.
  conduct(stage, n, T_old, T);
  const std::uint32_t closed = start_lanes(problem, operators.dt(), inputs, committed, trial, outputs);
  const std::optional<WaveContacts> contacts = contacts_of(problem, operators, inputs, committed);
  const WaveContacts* contact = contacts ? &*contacts : nullptr;
  std::uint32_t lost = solve_stage({problem, stage, inputs, contact, trial, first}, closed);

  // 2. Second stage: the same from the state extrapolated through the first.
  const double no_flux[kLanes] = {};
  sdirk2::begin_second_stage(stage, n, T_old, no_flux, T);
  lost |= sdirk2::lanes_out_of_range(problem, inputs, T_old, T);
  extrapolate_lanes(problem, inputs, closed & ~lost, committed, trial);
  lost |= solve_stage({problem, stage, inputs, contact, trial, second}, closed & ~lost);
  for (const int l : lanes_of(closed & ~lost)) {
    second[l] = step_of(first[l], second[l]);
    if (is_forced(problem) && second[l].stress[0] * second[l].mean_slip < 0.0) lost |= 1u << l;  // the slip turns
  }
  if (is_forced(problem)) lost |= sdirk2::lanes_out_of_range(problem, inputs, T_old, T);  // it heated one stage alone
  answer_lanes(problem, operators.dt(), inputs, closed & ~lost, second, trial, outputs);
  close_lanes(problem, inputs.active & ~lost, contact, second, trial, outputs);

  // 3. Lanes without an answer take a step of backward Euler instead.
  advance_aside(advance_with_inertia, problem, operators, inputs, lost, committed, trial, outputs);
  for (const int l : lanes_of(lost)) {
    if ((outputs.outcome[l] & kFailed) == 0) outputs.outcome[l] |= kFirstOrder;
  }
}

}  // namespace shearbus::physics
