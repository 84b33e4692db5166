// The balance of a velocity-driven step: the stress under which elastic shear, plastic flow and slip take the jump.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One solution of the balance with a given heat operator: a backward Euler step, or a stage of SDIRK2.
struct BalanceStage {
  const HeatOperator* heat;
  double dt;  // time over which the jump acts  [s]
  // In the second stage of SDIRK2, the heat flux of the first stage of each lane [W/m2]; `trial` then holds T_ad on
  // entry. In any other stage null.
  const double* early_flux = nullptr;
};
void solve_balance(const Problem& problem, const StepOperators& operators, const BalanceStage& stage,
                   const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
