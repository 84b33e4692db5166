#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/force_driven/wide_slip.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

using sdirk2::begin_second_stage;
using sdirk2::kDiagonal;
using sdirk2::kFirstWeight;
using sdirk2::lanes_out_of_range;

// The lanes (nodes) of which every vertex stays below melting under the flux. The second stage starts from extrapolated
// temperatures, so the hottest vertex may lie inside the layer.
std::uint32_t lanes_that_stay_solid(const HeatOperator& stage, int /*num_rows*/, const double (&flux)[kLanes],
                                    const double (&T_melt)[kLanes], const double* T_ad) {
  return lanes_below(stage.response, flux, T_melt, T_ad);
}
std::uint32_t lanes_that_stay_solid(const ModeOperator& step, int num_rows, const double (&flux)[kLanes],
                                    const double (&T_melt)[kLanes], const double* rows) {
  return lanes_below({&step.response, 1}, flux, T_melt, rows + (std::ptrdiff_t{num_rows} - 1) * kLanes);
}

// One lane whose search the kernels leave. Stresses and velocities are positive along `direction`.
struct StagedLane {
  StagedLane(const Problem& problem, const TileInputs& inputs, const Material& soft, int l)
      : limit(interface_strength(problem.interface, soft, inputs.pressure[l], inputs.effort)),
        forcing(forcing_of(inputs, l)),
        direction((inputs.velocity_jump[l] != 0.0 ? inputs.velocity_jump[l] : forcing.acceleration) < 0.0 ? -1.0 : 1.0),
        jump_old(direction * inputs.velocity_jump[l]) {}
  double free_jump(double dt) const { return jump_old + dt * direction * forcing.acceleration; }

  StressLimit limit;
  Forcing forcing;
  double direction;  // sign of the jump or, without a jump, sign of the acceleration
  double jump_old;   // jump before the step, along `direction`  [m/s]
};

// The stress of a lane in a stage. Nothing where the step may have several answers.
struct StageStress {
  double stress;
  bool sticks;
};
std::optional<StageStress> search(const StressLimit& limit, const FrictionHeating& heating, double a_stick,
                                  double guess) {
  if (spare_strength(limit, heating, a_stick) >= 0.0) return StageStress{a_stick, true};
  if (!slip_is_unique(limit, heating, a_stick)) return {};
  return StageStress{slip_stress(limit, heating, a_stick, guess), false};
}

// First stage: stress and heat flux at the time gamma dt, from the velocity jump at that time. A lane whose jump turns or
// stops within the step, or whose answer is not unique, stays unsolved: backward Euler then takes the step.
void first_stage_of(const StagedLane& lane, double heat_partition, const WideStage& stage, double dt, double guess,
                    int l, StageAnswer& answer, StageLanes& lanes) {
  const double free = lane.free_jump(stage.dt);
  if (lane.limit.pressure <= 0.0) lanes.solved |= 1u << l;
  if (lane.limit.pressure <= 0.0 || free < 0.0 || lane.free_jump(dt) < 0.0) return;
  const FrictionHeating heating{stage.T_ad[l], heat_partition * stage.B0, free, stage.dt * lane.forcing.mobility};
  const auto found = search(lane.limit, heating, free / heating.b, guess);
  if (!found || (found->sticks && lane.jump_old != 0.0)) return;
  lanes.solved |= 1u << l;
  if (found->sticks) lanes.resting |= 1u << l;
  answer.stress[l] = found->stress;
  answer.flux[l] = found->sticks ? 0.0 : heat_partition * (found->stress * heating.slip(found->stress));
}

// Second stage: the mean stress a of the step, in which the first stage's stress has the weight 1 - gamma:
//   a = (1 - gamma) s1 + gamma s_lim(T0),   (1 - gamma) q1 + gamma q = beta_T a [V]mid
// so that the heat of the step is the friction work of the step, as in a backward Euler step.
void second_stage_of(const StagedLane& lane, double heat_partition, const WideStage& stage, const StageAnswer& early,
                     double dt, bool rests, int l, WideAnswer& answer, StageLanes& lanes) {
  const double free = lane.free_jump(dt), per_stress = dt * lane.forcing.mobility;
  if (lane.limit.pressure <= 0.0) {
    lanes.solved |= 1u << l;
    answer.slip[l] = lane.direction * (0.5 * (lane.jump_old + free));
    answer.jump_new[l] = lane.direction * free;
    answer.regime[l] = static_cast<double>(Regime::kOpen);
    return;
  }
  if (rests) {
    if (!(lane.limit.at(stage.T_ad[l]).stress >= early.stress[l])) return;
    lanes.solved |= 1u << l;
    answer.stress[l] = lane.direction * early.stress[l];
    answer.regime[l] = static_cast<double>(Regime::kStick);
    return;
  }
  const StressLimit limit = lane.limit.scaled(kDiagonal, kFirstWeight * early.stress[l]);
  const FrictionHeating heating{stage.T_ad[l] - stage.B0 * (kFirstWeight / kDiagonal) * early.flux[l],
                                heat_partition * stage.B0 / kDiagonal, 0.5 * (lane.jump_old + free),
                                0.5 * dt * lane.forcing.mobility};
  const auto found = search(limit, heating, free / per_stress, early.stress[l]);
  if (!found || found->sticks) return;
  const double a = found->stress, slip = heating.slip(a);
  const double flux = (heat_partition * (a * slip) - kFirstWeight * early.flux[l]) / kDiagonal;
  const double T0 = stage.T_ad[l] + stage.B0 * flux;
  if (!(flux >= 0.0 && std::abs(limit.at(T0).stress - a) <= kMet * a)) return;
  lanes.solved |= 1u << l;
  answer.stress[l] = lane.direction * a;
  answer.slip[l] = lane.direction * slip;
  answer.jump_new[l] = lane.direction * (free - a * per_stress);
  answer.flux[l] = flux;
  answer.heat[l] = dt * (kFirstWeight * early.flux[l] + kDiagonal * flux);
  answer.regime[l] = static_cast<double>(slip_regime(lane.limit, T0, slip));
}

template <class Heat>
void advance(const Problem& problem, const StepOperators& operators, const Heat& first, const Heat& second,
             const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const int n = problem.heat_rows;
  const double dt = operators.dt(), partition = problem.heat_partition;
  const double* T_old = committed + layout.first_temperature();
  double* T = trial + layout.first_temperature();
  const double* T0 = trial + layout.temperature;
  const LaneMaterials soft(problem.options.soft, inputs);
  const WideStep stages{WideInterface(problem, inputs, soft, dt, committed), partition, dt};
  const bool wide = stages.interface.has_forms();  // else each lane is searched on its own
  const auto rare = [&](std::uint32_t left, const auto& stage_of) {
    for (const int l : lanes_of(left)) stage_of(StagedLane(problem, inputs, soft(l), l), l);
  };
  if (inputs.work != nullptr) {
    for (const int l : lanes_of(inputs.active)) add_work(inputs, l, 2.0 * (n + kSearchWork));
  }

  // 1. First stage: conduction, then stress and flux.
  conduct(first, n, T_old, T, layout.distance_to_next_tile());
  const WideStage early{T0, *first.layer_response(), first.dt};
  StageAnswer early_answer{};
  StageLanes lanes{0, 0, inputs.active};
  if (wide) lanes = wide_first_stage(stages, early, early_answer);
  rare(lanes.left, [&](const StagedLane& lane, int l) {
    first_stage_of(lane, partition, early, dt, std::abs(stages.interface.stress_before[l]), l, early_answer, lanes);
  });
  add_flux(first, n, early_answer.flux, T);

  // 2. Second stage. It starts from temperatures extrapolated from the old ones and those of the first stage.
  begin_second_stage(second, n, T_old, early_answer.flux, T);
  lanes.solved &= ~lanes_out_of_range(problem, inputs, T_old, T);
  const WideStage late{T0, *second.layer_response(), second.dt};
  WideAnswer answer{};
  StageLanes solved{0, 0, lanes.solved};
  if (wide) solved = wide_second_stage(stages, late, early_answer, lanes, answer);
  rare(solved.left, [&](const StagedLane& lane, int l) {
    second_stage_of(lane, partition, late, early_answer, dt, contains(lanes.resting, l), l, answer, solved);
  });
  double T_melt[kLanes];
  for (int l = 0; l < kLanes; ++l) T_melt[l] = soft(l).melting_temperature;
  solved.solved &= lanes_that_stay_solid(second, n, answer.flux, T_melt, T);
  for (int l = 0; l < kLanes; ++l) answer.flux[l] = contains(solved.solved, l) ? answer.flux[l] : 0.0;
  add_flux(second, n, answer.flux, T);

  // 3. Backward Euler for the active lanes to which SDIRK2 does not apply.
  const std::uint32_t fallen_back = inputs.active & ~solved.solved;
  advance_aside(advance_force_driven, problem, operators, inputs, fallen_back, committed, trial, outputs);
  for (const int l : lanes_of(fallen_back)) {
    // Marks the step as one of first order. A node that sticks at the end of the step is not marked, because the
    // order in time of its step does not matter.
    if (outputs.regime[l] != Regime::kStick) outputs.outcome[l] |= kFirstOrder;
  }

  // 4. Write the answers of the solved lanes.
  write_answer(problem, answer, solved.solved, trial, outputs);
  for (const int l : lanes_of(solved.solved)) outputs.interface_temperature[l] = T0[l];
}

}  // namespace

void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs) {
  if (problem.modes) {
    const StepOperators::ModeStages& stages = operators.mode_stages();
    advance(problem, operators, stages.first, stages.second, inputs, committed, trial, outputs);
  } else {
    advance(problem, operators, operators.stage(), operators.stage(), inputs, committed, trial, outputs);
  }
}

}  // namespace shearbus::physics
