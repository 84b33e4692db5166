// Models that are told a tolerance in place of cells and steps (MODEL.md section 3c).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {
namespace {

constexpr double kShortTime = 1e-9;   // the first cells resolve how far heat goes in this time  [s]
constexpr double kGrowth = 8.0;       // of neighbouring cells, over tolerance^kGrowthOrder
constexpr double kGrowthOrder = 0.7;  // measured: near melting the flow gathers on the grid, between orders 1 and 2
constexpr double kLeastGrowth = 1e-3;
constexpr double kKernelShare = 0.1;    // of the tolerance: the error of the modes' kernel
constexpr double kSubstepShare = 0.25;  // of the tolerance: what halving the substeps may change in one step
constexpr double kJumpSteps = 30.0;  // a jump that is off stays so: it heats as in a thousand steps, whose root this is
constexpr double kKink = 10.0;       // how much further off than halving tells, where the slip turns or stops
constexpr double kLeastRange = 0.01;   // of T_melt: what a tolerance is a part of where a layer starts near melting
constexpr double kLongestTime = 1e-3;  // heat older than this is forgotten by a half-space without profile  [s]

// Cells grow by a ratio g outward, from (g - 1) delta, where delta is how far heat goes in kShortTime: then every cell
// is (g - 1) times as wide as its distance from there.
GridOptions graded_for(GridOptions grid, double diffusivity, double tolerance) {
  const double growth = 1.0 + std::clamp(kGrowth * std::pow(tolerance, kGrowthOrder), kLeastGrowth, 1.0);
  const double ratio = 1.0 + grid.thickness / std::sqrt(diffusivity * kShortTime);  // of the last cell to the first
  grid.cells = std::max(2, static_cast<int>(std::ceil(std::log(ratio) / std::log(growth))));
  grid.grading = std::pow(ratio, 1.0 / grid.cells);
  return grid;
}

// Two states of one tile beside the caller's two.
struct Scratch {
  std::vector<double> first, second;
};
Scratch& scratch_of(std::size_t doubles) {
  thread_local Scratch scratch;
  if (scratch.first.size() < doubles) {
    scratch.first.resize(doubles);
    scratch.second.resize(doubles);
  }
  return scratch;
}

void add_substep(const TileOutputs& out, std::uint32_t active, double share, bool forced, TileOutputs& sum) {
  for (int l = 0; l < kLanes; ++l) {
    if (!(active >> l & 1u)) continue;
    // The host of a force-driven step exchanges momentum with the mean; velocity-driven it is told the stress at the
    // end.
    sum.shear_stress[l] = forced ? sum.shear_stress[l] + share * out.shear_stress[l] : out.shear_stress[l];
    sum.sliding_velocity[l] += share * out.sliding_velocity[l];
    sum.friction_heat[l] += out.friction_heat[l];
    sum.velocity_jump_new[l] = out.velocity_jump_new[l];
    sum.interface_temperature[l] = out.interface_temperature[l];
    sum.regime[l] = out.regime[l];
    sum.outcome[l] |= out.outcome[l];
  }
}

// The step of the active lanes in equal substeps from `committed`; returns the state they end in.
const double* advance_in_substeps(const Problem& problem, const StepOperators& substep, int substeps,
                                  const TileInputs& given, const double* committed, Scratch& scratch,
                                  TileOutputs& sum) {
  TileInputs inputs = given;
  const bool forced = problem.options.strategy == Strategy::kForceDriven;
  const double* from = committed;
  double* to = scratch.first.data();
  double* other = scratch.second.data();
  for (int j = 0; j < substeps; ++j) {
    TileOutputs out;
    advance_once(problem, substep, inputs, from, to, out);
    add_substep(out, inputs.active, 1.0 / substeps, forced, sum);
    if (forced) std::copy_n(out.velocity_jump_new, kLanes, inputs.velocity_jump);
    inputs.stress_before = nullptr;  // from here on the state's own
    from = to;
    std::swap(to, other);
  }
  return from;
}

// What substeps add up to, as the answer of the one step that the host asked for.
void take_lane(const Problem& problem, const TileInputs& inputs, const TileOutputs& sum, int l, TileOutputs& outputs) {
  outputs.shear_stress[l] = sum.shear_stress[l];
  outputs.sliding_velocity[l] = sum.sliding_velocity[l];
  outputs.interface_temperature[l] = sum.interface_temperature[l];
  outputs.velocity_jump_new[l] = sum.velocity_jump_new[l];
  outputs.friction_heat[l] = sum.friction_heat[l];
  outputs.regime[l] = sum.regime[l];
  outputs.outcome[l] = sum.outcome[l];
  // Where the slip reverses its mean could oppose the stress; friction does no negative work.
  if (sum.shear_stress[l] * sum.sliding_velocity[l] < 0.0) outputs.sliding_velocity[l] = 0.0;
  if (problem.options.strategy == Strategy::kVelocityDriven) {
    const double jump = inputs.velocity_jump[l];
    const bool carried = std::abs(sum.sliding_velocity[l] - jump) <= kOutsideDomainShare * std::abs(jump);
    outputs.outcome[l] &= static_cast<std::uint8_t>(~kOutsideDomain);
    if (!carried) outputs.outcome[l] |= kOutsideDomain;
  }
}

// How far apart two answers of one lane are, as a temperature: T0 itself; the heat released, which shows in T0 when it
// has left melting; and the host's new jump.
double distance(const TileOutputs& a, const TileOutputs& b, int l, double response, double dt, double heat_partition) {
  const double heat = response / dt * std::abs(a.friction_heat[l] - b.friction_heat[l]);
  const double stress = std::max(std::abs(a.shear_stress[l]), std::abs(b.shear_stress[l]));
  const double jump = std::abs(a.velocity_jump_new[l] - b.velocity_jump_new[l]);
  return std::max({std::abs(a.interface_temperature[l] - b.interface_temperature[l]), heat,
                   kJumpSteps * heat_partition * response * stress * jump});
}

// Whether the step has a kink, at which halvings may agree by chance: a host's jump that stops or turns, or what a
// second-order step left to the first order.
bool has_kink(const TileInputs& inputs, const TileOutputs& out, int l) {
  const double jump = inputs.velocity_jump[l];
  const bool turns = jump != 0.0 && !(out.velocity_jump_new[l] * std::copysign(1.0, jump) > 0.0);
  return turns || (out.outcome[l] & kFirstOrder) != 0;
}

}  // namespace

ModelOptions discretised(ModelOptions options, double tolerance) {
  options.tolerance = tolerance;
  const bool first_order = options.plastic_layer || options.junctions || options.inertia ||
                           options.interface.friction_law != FrictionLaw{} ||
                           options.soft.flow_law != FlowLaws::place<SteinbergCochranGuinan>();
  options.time_integrator = first_order ? TimeIntegrator::kBackwardEuler : TimeIntegrator::kSdirk2;
  options.grid = graded_for(options.grid, options.soft.diffusivity, tolerance);
  if (options.hard_grid) {
    options.hard_grid->cells = options.grid.cells;
    options.hard_grid->grading = options.grid.grading;
  } else if (options.strategy == Strategy::kForceDriven && !options.plastic_layer) {
    options.modes = {
        .accuracy = kKernelShare * tolerance, .shortest_step = kShortestControlledStep, .longest_time = kLongestTime};
  }
  return options;
}

std::string discretisation_of(const ModelOptions& options, std::size_t modes) {
  const char* integrator = options.time_integrator == TimeIntegrator::kSdirk2 ? "sdirk2" : "backward Euler";
  char text[160];
  if (modes > 0) {
    std::snprintf(text, sizeof text, "tolerance %g: no cells but %zu modes, %s in 2 to 64 substeps", *options.tolerance,
                  modes, integrator);
  } else {
    std::snprintf(text, sizeof text, "tolerance %g: %d cells growing by %.4g, %s in 2 to 64 substeps",
                  *options.tolerance, options.grid.cells, options.grid.grading, integrator);
  }
  return text;
}

// Each lane is halved until halving changes its answer by no more than its share of the tolerance, or the operators
// end; it looks at nothing but its own step.
void advance_controlled(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                        const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double T_melt = problem.options.soft.melting_temperature;
  const double scale = 1.0 / std::max(T_melt - problem.options.initial_temperature, kLeastRange * T_melt);
  const double allowed = kSubstepShare * *problem.options.tolerance;
  Scratch& scratch = scratch_of(layout.doubles);
  advance_once(problem, operators, inputs, committed, trial, outputs);
  const double response = problem.modes ? operators.modes().response : operators.heat().layer_response()[0];
  TileOutputs coarser = outputs;
  TileInputs open = inputs;
  for (int times = 1; open.active != 0; ++times) {
    TileOutputs finer{};
    const double* states =
        advance_in_substeps(problem, operators.halved(times), 1 << times, open, committed, scratch, finer);
    for (int l = 0; l < kLanes; ++l) {
      if (!(open.active >> l & 1u)) continue;
      const double kink = has_kink(inputs, finer, l) ? kKink : 1.0;
      const double change =
          kink * scale * distance(finer, coarser, l, response, operators.dt(), problem.heat_partition);
      if (change > allowed && times < operators.times_halved()) continue;
      open.active &= ~(1u << l);
      outputs.error_estimate[l] = change;
      if ((finer.outcome[l] & kFailed) != 0) {
        keep_lane(problem, inputs, committed, trial, l, outputs);
        continue;
      }
      copy_lane(states, trial, layout.doubles, l);
      take_lane(problem, inputs, finer, l, outputs);
      trial[layout.shear_stress + static_cast<std::size_t>(l)] = outputs.shear_stress[l];
    }
    coarser = finer;
  }
}

}  // namespace shearbus::physics
