// The velocity-driven step (MODEL.md, "Velocity-driven step"): DLP (37), (42-48), (56), with the drive that is missing
// in DLP (56). The host imposes the velocity jump; the stress follows from the plastic flow of the layer.
#pragma once

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One solution of the balance with a given heat operator: a backward Euler step, or a stage of SDIRK2.
struct BalanceStage {
  const HeatOperator* heat;
  double dt;                           // time over which the jump acts  [s]
  const double* early_flux = nullptr;  // flux of the first stage, [lane]  [W/m2]; if set, `trial` already holds T_ad
};
void solve_balance(const Problem& problem, const StepOperators& operators, const BalanceStage& stage,
                   const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

// One backward Euler step of the active lanes; the rest of `trial` is left for the caller.
void advance_velocity_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                             const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
