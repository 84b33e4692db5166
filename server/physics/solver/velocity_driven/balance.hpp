// The velocity-driven step (MODEL.md, "Velocity-driven step"): DLP (37), (42-48), (56). The host imposes the velocity
// jump; the stress follows from the plastic flow of the layer. DLP (56) omits the velocity that shears the layer.
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

// One backward Euler step of the active lanes; the caller restores the states of the other lanes of `trial`.
void advance_velocity_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                             const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
