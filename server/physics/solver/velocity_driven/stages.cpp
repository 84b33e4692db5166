#include "server/physics/solver/velocity_driven/stages.hpp"

#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/velocity_driven/balance.hpp"

namespace shearbus::physics {

using sdirk2::begin_second_stage;
using sdirk2::lanes_out_of_range;

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

}  // namespace shearbus::physics
