#include "server/physics/solver/around/sleep.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/melting/phase_change.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

constexpr int kLeastStepsBeforeSleep = 16;
// Margin added to the temperature of the hottest vertex; far above the rounding errors of the modes  [K].
constexpr double kTemperatureMargin = 1e-6;
constexpr double kStrengthMargin = 1.0 - 1e-9;  // factor on the flow stress, a margin far above rounding errors

int living(const TileLayout& layout, const double* tile, int lane) {
  return static_cast<int>(tile[layout.resting + kLanes + lane]);
}

// The strength at the temperature of the hottest vertex and the strain of the least strained vertex is a lower bound of
// the layer's strength. This bound holds as long as the lane sleeps: without a source diffusion only levels the
// temperature, and without flow the strain is constant.
struct WeakestVertex {
  double temperature;   // temperature of the hottest vertex         [K]
  double strain = 0.0;  // plastic strain of the least strained vertex of a layer that can flow
};

WeakestVertex weakest_vertex(const Problem& problem, const double* tile, int lane) {
  const TileLayout& layout = problem.layout;
  const double* T = tile + layout.first_temperature() + lane;
  double hottest = T[0];
  for (std::ptrdiff_t i = 1; i < problem.heat_grid.num_vertices(); ++i) hottest = std::max(hottest, T[i * kLanes]);
  if (layout.plastic_strain == TileLayout::kAbsent) return {hottest};
  const double* strain = tile + layout.plastic_strain + lane;
  double least = strain[0];
  for (std::ptrdiff_t i = 1; i < problem.grid.num_vertices(); ++i) least = std::min(least, strain[i * kLanes]);
  return {hottest, least};
}

// Whether certainly no vertex flows under the stress magnitude `stress`, with margins far above rounding. Compares with
// the flow stress at strain rate 0, which a rate can only raise. `soft`: the soft material at the pressure.
bool surely_rigid(const Material& soft, double pressure, double stress, const WeakestVertex& weakest) {
  const double strength = flow_stress(soft, weakest.strain, pressure, weakest.temperature + kTemperatureMargin);
  return kSqrt3 * stress <= kStrengthMargin * strength;
}

// Whether certainly nothing melts or flows in a step at rest.
bool surely_at_rest(const Problem& problem, const Material& soft, double pressure, Regime regime, double stress,
                    const WeakestVertex& weakest) {
  if (problem.options.melt_film) return weakest.temperature + kTemperatureMargin < soft.melting_temperature;
  return regime == Regime::kOpen || surely_rigid(soft, pressure, std::abs(stress), weakest);
}

// The step of a sleeping lane; empty where heat or flow wakes the lane.
std::optional<LaneResult> step_at_rest(const Problem& problem, const StepOperators& operators, StepAtRest* at_rest,
                                       const TileInputs& inputs, const double* committed, const Material& soft,
                                       double T0, int lane) {
  const TileLayout& layout = problem.layout;
  const std::optional<LaneResult> found = at_rest(problem, operators, inputs, committed, soft, T0, lane);
  if (found && layout.hottest_at_rest != TileLayout::kAbsent) {
    const bool can_flow = layout.least_strain_at_rest != TileLayout::kAbsent;
    const WeakestVertex weakest{committed[layout.hottest_at_rest + lane],
                                can_flow ? committed[layout.least_strain_at_rest + lane] : 0.0};
    if (!surely_at_rest(problem, soft, inputs.pressure[lane], found->step.regime, found->step.stress, weakest))
      return std::nullopt;
  }
  return found;
}

// Whether a solved step brought neither heat nor flow, so that step_at_rest would have given the same answer. Where the
// jump is slip a step under a jump may start from the yield stress instead of the old one.
bool rested(const Problem& problem, const TileInputs& inputs, const TileOutputs& outputs, int lane) {
  if (outputs.friction_heat[lane] != 0.0 || (outputs.outcome[lane] & ~kOutsideDomain) != 0) return false;
  const Regime regime = outputs.regime[lane];
  return regime == Regime::kOpen ||
         (regime == Regime::kStick && !(jump_is_slip(problem.options) && inputs.velocity_jump[lane] != 0.0));
}

// A copy of the committed tile in which the waking lanes hold temperatures again instead of amplitudes.
const double* waking_tile(const Problem& problem, std::uint32_t waking, const double* committed) {
  const TileLayout& layout = problem.layout;
  double* states = scratch_tile(Scratch::kWaking, layout.doubles);
  std::copy_n(committed, layout.doubles, states);
  for (const int l : lanes_of(waking)) profile_of(problem, committed, l, states + layout.first_temperature());
  return states;
}

void write_sleeping_lane(const Problem& problem, const TileInputs& inputs, const double* committed,
                         const LaneResult& resting, double T0, int num_live, int lane, double* trial,
                         TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const LaneStep& step = resting.step;
  write_answer(resting, layout, lane, trial, outputs);
  outputs.outcome[lane] |= kAsleep;
  if (layout.stress_rate != TileLayout::kAbsent) trial[layout.stress_rate + lane] = 0.0;
  if (layout.sticking != TileLayout::kAbsent) trial[layout.sticking + lane] = step.sticks ? 1.0 : 0.0;
  trial[layout.resting + lane] = committed[layout.resting + lane] + 1.0;
  trial[layout.resting + kLanes + lane] = num_live;
  outputs.interface_temperature[lane] = T0;
  if (problem.options.melt_film) outputs.film_thickness[lane] = 0.0;
  if (inputs.wants_mean_stress) {  // the stress of a layer at rest changes linearly in time
    const double before = stress_before(layout, inputs, committed, lane);
    outputs.mean_shear_stress[lane] = step.regime == Regime::kOpen ? 0.0 : 0.5 * (before + step.stress);
  }
}

// Counts the steps at rest of a lane that was solved and puts the lane to sleep after enough of them. A lane that might
// flow stays awake, and its count starts again.
void count_rest(const Problem& problem, const TileInputs& inputs, const double* committed, const Material& soft,
                int lane, double* trial, const TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double before = asleep(layout, committed, lane) ? 0.0 : committed[layout.resting + lane];
  const double steps = rested(problem, inputs, outputs, lane) ? before + 1.0 : 0.0;
  WeakestVertex weakest{};
  bool sleeps = steps >= problem.steps_before_sleep;
  if (sleeps && layout.hottest_at_rest != TileLayout::kAbsent) {
    weakest = weakest_vertex(problem, trial, lane);
    sleeps = surely_at_rest(problem, soft, inputs.pressure[lane], outputs.regime[lane], outputs.shear_stress[lane],
                            weakest) &&
             (!problem.options.melt_film || outputs.film_thickness[lane] == 0.0);
  }
  trial[layout.resting + lane] = sleeps || steps < problem.steps_before_sleep ? steps : 0.0;
  trial[layout.resting + kLanes + lane] =
      sleeps ? to_modes(*problem.basis, lane, trial + layout.first_temperature()) : 0.0;
  if (layout.hottest_at_rest == TileLayout::kAbsent) return;
  trial[layout.hottest_at_rest + lane] = sleeps ? weakest.temperature : 0.0;
  if (layout.least_strain_at_rest != TileLayout::kAbsent)
    trial[layout.least_strain_at_rest + lane] = sleeps ? weakest.strain : 0.0;
}

// Heat in the two bodies of one lane, relative to bodies at a uniform reference temperature.
struct Held {
  double soft, hard;  // heat in the soft and in the hard body, relative to a reference temperature  [J/m2]
};
Held held_heat(const Problem& problem, const double* tile, int lane, double reference) {
  const HeatGrid& grid = problem.heat_grid;
  const double* rows = tile + problem.layout.first_temperature() + lane;
  Held held{};
  if (asleep(problem.layout, tile, lane)) {
    // Every mode but the first holds no net heat in both bodies together.
    const HeatBasis& basis = *problem.basis;
    if (basis.holds_ends) {
      for (std::size_t k = 0; k < basis.rate.size(); ++k) {
        const double amplitude = rows[static_cast<std::ptrdiff_t>(k) * kLanes] - (k == 0 ? reference : 0.0);
        held.soft += basis.soft_heat[k] * amplitude;
        if (problem.options.hard_grid) held.hard += basis.hard_heat[k] * amplitude;
      }
      return held;
    }
    if (!problem.options.hard_grid) return {basis.heat * (rows[0] - reference), 0.0};
    held.soft = basis.soft_heat[0] * (rows[0] - reference);
    for (std::ptrdiff_t k = 1; k < basis.num_modes(); ++k)
      held.soft += basis.soft_heat[static_cast<std::size_t>(k)] * rows[k * kLanes];
    held.hard = basis.heat * (rows[0] - reference) - held.soft;
    return held;
  }
  for (int i = 0; i < grid.num_vertices(); ++i) {
    const double heat =
        grid.capacity(i, problem.options.soft, problem.options.hard) * (rows[std::ptrdiff_t{i} * kLanes] - reference);
    const double in_soft = i < grid.interface ? 0.0 : i == grid.interface ? problem.soft_share_at_interface() : 1.0;
    held.soft += in_soft * heat;
    held.hard += (1.0 - in_soft) * heat;
  }
  return held;
}

}  // namespace

int steps_before_sleep(int num_heat_vertices) {
  return std::max(kLeastStepsBeforeSleep, num_heat_vertices / 4);
}

double interface_temperature(const Problem& problem, const double* tile, int lane) {
  const TileLayout& layout = problem.layout;
  if (!asleep(layout, tile, lane)) return tile[layout.temperature + lane];
  const double* amplitude = tile + layout.first_temperature() + lane;
  double T0 = 0.0;
  for (std::ptrdiff_t k = living(layout, tile, lane); k-- > 0;)
    T0 += problem.basis->at_interface[static_cast<std::size_t>(k)] * amplitude[k * kLanes];
  return T0;
}

void profile_of(const Problem& problem, const double* tile, int lane, double* temperature) {
  const TileLayout& layout = problem.layout;
  const double* rows = tile + layout.first_temperature();
  if (asleep(layout, tile, lane)) {
    to_profile(*problem.basis, living(layout, tile, lane), lane, rows, temperature);
    return;
  }
  copy_lane(rows, temperature, static_cast<std::size_t>(problem.heat_grid.num_vertices()) * kLanes, lane);
}

StoredHeat stored_heat(const Problem& problem, const double* committed, const double* trial, const double* entered) {
  const TileLayout& layout = problem.layout;
  const std::size_t first = layout.first_temperature();
  int num_awake = 0;
  bool slept[kLanes], sleeps[kLanes];
  for (int l = 0; l < kLanes; ++l) {
    slept[l] = asleep(layout, committed, l);
    sleeps[l] = asleep(layout, trial, l);
    num_awake += slept[l] || sleeps[l] ? 0 : 1;
  }
  StoredHeat stored;
  if (num_awake > 0) stored = stored_in_rows(problem, committed + first, trial + first, entered);
  for (int l = 0; l < kLanes; ++l) {
    if (!slept[l] && !sleeps[l]) continue;
    stored.soft[l] = stored.hard[l] = 0.0;
    const bool keeps = !problem.options.hard_grid && !problem.basis->holds_ends;
    if (slept[l] && sleeps[l] && keeps) continue;  // while asleep the only body keeps its heat
    // Heat is measured from the mean temperature of the sleeping state, so that the differences cancel little.
    const double reference = (slept[l] ? committed : trial)[first + static_cast<std::size_t>(l)];
    const Held before = held_heat(problem, committed, l, reference);
    const Held after = held_heat(problem, trial, l, reference);
    stored.soft[l] = after.soft - before.soft;
    stored.hard[l] = after.hard - before.hard;
  }
  if (problem.options.melt_film) add_latent_heat(problem, committed, trial, stored.soft);
  return stored;
}

void advance_with_sleep(const Problem& problem, const StepOperators& operators, AdvanceTile solve, StepAtRest* at_rest,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const HeatBasis& basis = *problem.basis;
  const double* decay = operators.decay();
  const double* rows = committed + layout.first_temperature();
  double* rows_new = trial + layout.first_temperature();

  // 1. Find the sleeping lanes, and their interface temperatures at the end of the step.
  std::uint32_t sleeping = 0;
  int num_live = 0;
  for (const int l : lanes_of(inputs.active)) {
    if (!asleep(layout, committed, l)) continue;
    sleeping |= 1u << l;
    num_live = std::max(num_live, living(layout, committed, l));
  }
  double T0[kLanes];
  if (sleeping != 0) interface_later(basis, decay, num_live, rows, T0);

  // 2. Find the sleeping lanes that stay asleep (`resting`), and their steps.
  LaneResult steps_at_rest[kLanes];
  std::uint32_t resting = 0;
  const LaneMaterials soft_at(problem.options.soft, inputs);
  for (const int l : lanes_of(sleeping)) {
    const auto step = step_at_rest(problem, operators, at_rest, inputs, committed, soft_at(l), T0[l], l);
    if (!step) continue;
    steps_at_rest[l] = *step;
    resting |= 1u << l;
  }

  // 3. Solve the lanes that are awake or wake in this step.
  const std::uint32_t solved = inputs.active & ~resting;
  if (solved != 0) {
    TileInputs others = inputs;
    others.active = solved;
    const std::uint32_t waking = sleeping & solved;
    const double* from = waking != 0 ? waking_tile(problem, waking, committed) : committed;
    solve(problem, operators, others, from, trial, outputs);
    for (const int l : lanes_of(solved)) count_rest(problem, inputs, committed, soft_at(l), l, trial, outputs);
  }
  if (resting == 0) return;

  // 4. Step the lanes that stay asleep: their modes decay, and stress, regime, the count of steps at rest and
  // the number of live modes are set. The other states stay.
  if (solved == 0) {
    const auto behind = static_cast<std::ptrdiff_t>(layout.temperature + layout.num_vertices * kLanes);
    std::copy_n(committed + behind, static_cast<std::ptrdiff_t>(layout.doubles) - behind, trial + behind);
    decay_modes(decay, num_live, basis.num_modes(), rows, rows_new);
  }
  for (const int l : lanes_of(resting)) {
    if (solved != 0) {
      copy_lane(committed, trial, layout.doubles, l);
      for (std::ptrdiff_t k = 0; k < basis.num_modes(); ++k) rows_new[k * kLanes + l] *= decay[k];
    }
    const int lives = still_living(living(layout, committed, l), l, rows_new);
    write_sleeping_lane(problem, inputs, committed, steps_at_rest[l], T0[l], lives, l, trial, outputs);
  }
}

}  // namespace shearbus::physics
