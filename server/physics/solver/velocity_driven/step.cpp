#include <cmath>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/velocity_driven/balance.hpp"
#include "server/physics/solver/velocity_driven/elastic_trial.hpp"

namespace shearbus::physics {

using sdirk2::begin_second_stage;
using sdirk2::lanes_out_of_range;

void advance_velocity_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                             const double* committed, double* trial, TileOutputs& outputs) {
  solve_balance(problem, operators, {&operators.heat(), operators.dt()}, inputs, committed, trial, outputs);
}

// Only the conduction of heat is approximated in time; the balance of elastic strain, plastic flow and slip is exact
// over a step of any length. Both stages therefore start from the old stress and strain. The first stage covers gamma
// dt, and only its heat flux is used; the second stage covers dt and gives the answer.
void advance_velocity_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                    const double* committed, double* trial, TileOutputs& outputs) {
  const HeatOperator& stage = operators.stage();
  const int n = problem.heat_rows;
  const double* T_old = committed + problem.layout.first_temperature();
  double* T = trial + problem.layout.first_temperature();

  // 1. First stage of SDIRK2: a step over gamma dt, of which only the heat flux is used.
  solve_balance(problem, operators, {&stage, stage.dt}, inputs, committed, trial, outputs);
  double early_flux[kLanes] = {};
  for (const int l : lanes_of(inputs.active)) early_flux[l] = outputs.friction_heat[l] / stage.dt;

  // 2. Second stage of SDIRK2: the whole step, from temperatures extrapolated from the first stage.
  begin_second_stage(stage, n, T_old, early_flux, T);
  const std::uint32_t fallen_back = lanes_out_of_range(problem, inputs, T_old, T);
  TileInputs theirs = inputs;
  theirs.active = inputs.active & ~fallen_back;
  solve_balance(problem, operators, {&stage, operators.dt(), early_flux}, theirs, committed, trial, outputs);

  // 3. Lanes (nodes) whose extrapolated temperatures are out of range take a step of backward Euler instead.
  advance_aside(advance_velocity_driven, problem, operators, inputs, fallen_back, committed, trial, outputs);
  for (const int l : lanes_of(fallen_back)) outputs.outcome[l] |= kFirstOrder;
}

std::optional<LaneResult> velocity_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                       const TileInputs& inputs, const double* committed,
                                                       const Material& soft, double T0, int lane) {
  const double jump = inputs.velocity_jump[lane];
  const double pressure = inputs.pressure[lane];
  const auto resting = [jump](double stress, double slip, Regime regime, bool sticks) {
    return LaneResult{{stress, slip, jump, 0.0, regime, sticks, true, false}, 0.0, 0.0, outside_domain(slip, jump)};
  };
  if (pressure <= 0.0) return resting(0.0, jump, Regime::kOpen, false);
  const ElasticTrial trial = elastic_trial(problem, soft, inputs, lane, operators.dt(),
                                           stress_before(problem.layout, inputs, committed, lane));
  const double limit =
      contact_limit(problem, soft, pressure, operators.dt(), contact_before(problem, committed, lane), nullptr)
          .at(T0)
          .stress;
  if (trial.heats() || (jump_is_slip(problem.options) && jump != 0.0) || limit < std::abs(trial.stress))
    return std::nullopt;
  // The slip is 0 with the sign that solve_balance() gives it, so that both functions give the same bits.
  const double slip = problem.options.drive == Drive::kLayerShear ? std::copysign(0.0, trial.direction) : 0.0;
  return resting(trial.stress, slip, Regime::kStick, true);
}

}  // namespace shearbus::physics
