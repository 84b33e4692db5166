// What a model knows before the first step: shared by both strategies, constant afterwards.
#pragma once

#include <optional>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct Problem {
  explicit Problem(const ModelOptions& model_options);

  ModelOptions options;
  Grid grid;
  HeatGrid heat_grid;
  std::optional<HeatModes> modes;  // in place of a profile
  TileLayout layout;
  int heat_rows;          // of the heat's state in a tile, from layout.first_temperature() on
  double heat_partition;  // share of the friction power the conducting bodies take: beta_T, or all where both conduct
};

// One solution of the velocity-driven balance under given heat: a backward Euler step, or a stage of SDIRK2.
struct BalanceStage {
  const HeatOperator* heat;
  double dt;  // over which the jump acts  [s]
  // The second stage finds T_ad in `trial`, and lanes whose extrapolation left its domain with that of `fallback`.
  bool conducted = false;
  const double* early_flux = nullptr;  // q of the first stage, [lane]  [W/m2]
  std::uint32_t fallen_back = 0;
  const HeatOperator* fallback = nullptr;
};
void solve_balance(const Problem& problem, const StepOperators& operators, const BalanceStage& stage,
                   const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs);

// One step of the active lanes of a tile; the rest of `trial` is left for the caller.
void advance_velocity_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                             const double* committed, double* trial, TileOutputs& outputs);
void advance_velocity_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                    const double* committed, double* trial, TileOutputs& outputs);
void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs);
void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);
void advance_force_driven_flowing(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
