#include "server/physics/solver/velocity_driven/inertia.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/velocity_driven/waves_wide.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

void gather(const double* rows, int count, double* values) {
  for (std::ptrdiff_t i = 0; i < count; ++i) values[i] = rows[i * kLanes];
}

void scatter(const double* values, int count, double* rows) {
  for (std::ptrdiff_t i = 0; i < count; ++i) rows[i * kLanes] = values[i];
}

// What a stage, or a step of two stages, has found in one lane.
struct Found {
  double flux = 0.0;             // heat flux q into the layer: of a step its mean  [W/m2]
  double slip_along[2] = {};     // flow and slip at z = 0 along stresses above 0, and along stresses below 0  [m]
  bool interface_slips = false;  // at the end the friction limit holds the stress at z = 0
  double stress[2] = {};         // stress at z = 0 and at z = h; of a step the means in its balance of momentum  [Pa]
};

// The step of two stages of SDIRK2. Slip takes the weight that extrapolates the first stage to the start of the second.
Found step_of(const Found& first, const Found& second) {
  const auto slip = [&](int k) { return sdirk2::kExtrapolation * first.slip_along[k] + second.slip_along[k]; };
  const auto mean = [](double one, double two) { return sdirk2::kFirstWeight * one + sdirk2::kDiagonal * two; };
  return {.flux = mean(first.flux, second.flux),
          .slip_along = {slip(0), slip(1)},
          .interface_slips = second.interface_slips,
          .stress = {mean(first.stress[0], second.stress[0]), mean(first.stress[1], second.stress[1])}};
}

// An open contact: the layer moves with the soft body without stress, until the contact closes.
void open_lane(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial, int l,
               TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double jump = inputs.velocity_jump[l];
  for (std::size_t i = 0; i < layout.num_stress_vertices; ++i) trial[layout.shear_stress + i * kLanes + l] = 0.0;
  for (std::size_t i = 0; i < layout.num_velocity_cells; ++i) trial[layout.layer_velocity + i * kLanes + l] = jump;
  for (std::size_t i = 0; i < layout.num_strain_vertices; ++i) {
    trial[layout.plastic_strain + i * kLanes + l] = committed[layout.plastic_strain + i * kLanes + l];
  }
  outputs.shear_stress[l] = 0.0;
  if (inputs.wants_mean_stress) outputs.mean_shear_stress[l] = outputs.mean_far_stress[l] = 0.0;
  outputs.sliding_velocity[l] = jump;
  outputs.friction_heat[l] = 0.0;
  outputs.regime[l] = Regime::kOpen;
  outputs.outcome[l] = 0;
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
  for (const int l : lanes_of(inputs.active)) {
    if (committed[layout.regime + l] != static_cast<double>(Regime::kOpen)) continue;
    for (std::size_t i = 0; i < layout.num_velocity_cells; ++i)
      trial[layout.layer_velocity + i * kLanes + l] = inputs.velocity_jump[l];
  }
}

double friction_limit(const Problem& problem, const Material& soft, const TileInputs& inputs, const double* trial,
                      int l) {
  const double T_ad = trial[problem.layout.temperature + l];
  return interface_strength(problem.interface, soft, inputs.pressure[l], nullptr).friction(T_ad).stress;
}

// Backward Euler of one lane over the length of `heat`, from the state in `trial`, whose temperatures have been
// conducted already. Returns false if no answer was found.
bool search_lane(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs, double* trial, int l,
                 Found& found) {
  const TileLayout& layout = problem.layout;
  const Grid& grid = problem.grid;
  const int n = grid.num_cells();
  const Material soft = at_pressure(problem.options.soft, inputs.pressure[l]);
  const WaveStep step{.soft = &soft,
                      .grid = &grid,
                      .response = heat.layer_response(),
                      .dt = heat.dt,
                      .pressure = inputs.pressure[l],
                      .jump = inputs.velocity_jump[l],
                      .heat_share = problem.heat_partition,
                      .coulomb = friction_limit(problem, soft, inputs, trial, l)};
  WaveFields fields;
  gather(trial + layout.temperature + l, n + 1, fields.T_ad);
  gather(trial + layout.plastic_strain + l, n + 1, fields.strain);
  gather(trial + layout.shear_stress + l, n + 1, fields.stress);
  gather(trial + layout.layer_velocity + l, n, fields.velocity);

  const WaveAnswer answer = advance_waves(step, fields);
  if (inputs.effort != nullptr) {
    inputs.effort->newton_steps += answer.iterations;
    inputs.effort->guarded_steps += answer.guarded ? 1 : 0;
  }
  add_work(inputs, l, n * (1.0 + flow_work(soft.flow_law) * answer.iterations));
  if (!answer.found) return false;

  // A vertex flows in the direction of its stress. A stress that has fallen to 0 keeps its sign as +0 or -0.
  found = {.flux = answer.flux,
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

// The same of several lanes: by Newton's method in all of them at once, and by search_lane() where that has not found an
// answer. Returns the lanes that have none.
std::uint32_t solve_stage(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                          std::uint32_t lanes, double* trial, Found (&found)[kLanes]) {
  if (lanes == 0) return 0;
  const TileLayout& layout = problem.layout;
  const int n = problem.grid.num_cells();
  const Material& any = problem.options.soft;
  if (!properties_of(any.flow_law).has_wave_return) {
    std::uint32_t unsolved = 0;
    for (const int l : lanes_of(lanes))
      if (!search_lane(problem, heat, inputs, trial, l, found[l])) unsolved |= 1u << l;
    return unsolved;
  }
  WideWaveStep step{.soft = &any,
                    .grid = &problem.grid,
                    .response = heat.layer_response(),
                    .dt = heat.dt,
                    .heat_share = problem.heat_partition,
                    .T_melt = {},
                    .bracket = {},
                    .jump = {},
                    .coulomb = {},
                    .T_ad = trial + layout.temperature,
                    .strain = trial + layout.plastic_strain,
                    .stress = trial + layout.shear_stress,
                    .velocity = trial + layout.layer_velocity};
  for (const int l : lanes_of(lanes)) {
    const Material soft = at_pressure(any, inputs.pressure[l]);
    step.T_melt[l] = soft.melting_temperature;
    step.bracket[l] = 1.0 + soft.pressure_coefficient * inputs.pressure[l] +
                      soft.temperature_coefficient * SteinbergCochranGuinan::kReference;
    step.jump[l] = inputs.velocity_jump[l];
    step.coulomb[l] = friction_limit(problem, soft, inputs, trial, l);
  }
  WideWaveAnswer answer;
  const std::uint32_t solved = advance_waves_wide(step, lanes, answer);
  std::uint32_t lost = 0;
  for (const int l : lanes_of(lanes)) {
    if (!contains(solved, l)) {
      if (!search_lane(problem, heat, inputs, trial, l, found[l])) lost |= 1u << l;
      continue;
    }
    if (inputs.effort != nullptr) inputs.effort->newton_steps += static_cast<int>(answer.iterations[l]);
    add_work(inputs, l, n * (1.0 + answer.iterations[l]));
    const double* stress = trial + layout.shear_stress + l;
    found[l] = {.flux = answer.flux[l],
                .slip_along = {answer.slip_along[0][l], answer.slip_along[1][l]},
                .interface_slips = answer.interface_slip[l] != 0.0,
                .stress = {stress[0], stress[std::ptrdiff_t{n} * kLanes]}};
    found[l].slip_along[std::signbit(stress[0])] += answer.interface_slip[l] * heat.dt;
    add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux[l], trial + layout.first_temperature());
  }
  return lost;
}

// Writes the answer of a closed lane. [v] is the slip along s(0): what flows against s(0), because waves have turned the
// stress there, works against another stress than the interface's. Without stress at z = 0 it is the whole slip.
void answer_lane(const Problem& problem, double dt, const TileInputs& inputs, const Found& found, const double* trial,
                 int l, double hottest, TileOutputs& outputs) {
  const double melts_at = kMeltingShare * at_pressure(problem.options.soft, inputs.pressure[l]).melting_temperature;
  const double stress = trial[problem.layout.shear_stress + l];
  const bool carries = std::abs(stress) >= kNoStress;
  const double slip = (carries && stress < 0.0 ? 0.0 : found.slip_along[0]) / dt -
                      (carries && stress > 0.0 ? 0.0 : found.slip_along[1]) / dt;
  outputs.shear_stress[l] = !carries && slip * stress < 0.0 ? 0.0 : stress;
  outputs.sliding_velocity[l] = slip;
  outputs.friction_heat[l] = found.flux * dt;
  if (inputs.wants_mean_stress) {
    outputs.mean_shear_stress[l] = found.stress[0];
    outputs.mean_far_stress[l] = found.stress[1];
  }
  outputs.regime[l] = slip == 0.0             ? Regime::kStick
                      : found.interface_slips ? Regime::kCoulomb
                      : hottest >= melts_at   ? Regime::kMelting
                                              : Regime::kTresca;
  outputs.outcome[l] = outside_domain(slip, inputs.velocity_jump[l]);
}

void answer_lanes(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes,
                  const Found (&found)[kLanes], const double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  double coldest[kLanes], hottest[kLanes];
  range_of_rows(static_cast<std::ptrdiff_t>(layout.num_strain_vertices), trial + layout.temperature, coldest, hottest);
  for (const int l : lanes_of(lanes)) answer_lane(problem, dt, inputs, found[l], trial, l, hottest[l], outputs);
}

// Writes what an answer of any regime has, and the regime into the state.
void close_lane(const Problem& problem, const TileInputs& inputs, double* trial, int l, TileOutputs& outputs) {
  outputs.interface_temperature[l] = trial[problem.layout.temperature + l];
  outputs.velocity_jump_new[l] = inputs.velocity_jump[l];
  trial[problem.layout.regime + l] = static_cast<double>(outputs.regime[l]);
}

// Answers the lanes whose contact is open, and copies the state of the others from which the step starts. Returns the
// latter.
std::uint32_t start_lanes(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial,
                          TileOutputs& outputs) {
  copy_start(problem, inputs, committed, trial);
  std::uint32_t closed = inputs.active;
  for (const int l : lanes_of(inputs.active)) {
    if (inputs.pressure[l] > 0.0) continue;
    open_lane(problem, inputs, committed, trial, l, outputs);
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
  const std::uint32_t closed = start_lanes(problem, inputs, committed, trial, outputs);
  Found found[kLanes];
  const std::uint32_t lost = solve_stage(problem, operators.heat(), inputs, closed, trial, found);
  answer_lanes(problem, operators.dt(), inputs, closed & ~lost, found, trial, outputs);
  for (const int l : lanes_of(inputs.active & ~lost)) close_lane(problem, inputs, trial, l, outputs);
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
  const std::uint32_t closed = start_lanes(problem, inputs, committed, trial, outputs);
  std::uint32_t lost = solve_stage(problem, stage, inputs, closed, trial, first);

  // 2. Second stage: the same from the state extrapolated through the first.
  const double no_flux[kLanes] = {};
  sdirk2::begin_second_stage(stage, n, T_old, no_flux, T);
  lost |= sdirk2::lanes_out_of_range(problem, inputs, T_old, T);
  extrapolate_lanes(problem, inputs, closed & ~lost, committed, trial);
  lost |= solve_stage(problem, stage, inputs, closed & ~lost, trial, second);
  for (const int l : lanes_of(closed & ~lost)) second[l] = step_of(first[l], second[l]);
  answer_lanes(problem, operators.dt(), inputs, closed & ~lost, second, trial, outputs);
  for (const int l : lanes_of(inputs.active & ~lost)) close_lane(problem, inputs, trial, l, outputs);

  // 3. Lanes without an answer take a step of backward Euler instead.
  if (lost == 0) return;
  const std::size_t doubles = problem.layout.doubles;
  double* fallback = scratch_tile(Scratch::kStages, doubles);
  TileInputs theirs = inputs;
  theirs.active = lost;
  advance_with_inertia(problem, operators, theirs, committed, fallback, outputs);
  for (const int l : lanes_of(lost)) {
    copy_lane(fallback, trial, doubles, l);
    if ((outputs.outcome[l] & kFailed) == 0) outputs.outcome[l] |= kFirstOrder;
  }
}

}  // namespace shearbus::physics
