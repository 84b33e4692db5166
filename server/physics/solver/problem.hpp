// What a model knows before the first step: shared by both strategies, constant afterwards.
#pragma once

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct Problem {
  explicit Problem(const ModelOptions& model_options);

  ModelOptions options;
  Grid grid;
  HeatGrid heat_grid;
  TileLayout layout;
  double heat_partition;  // share of the friction power the conducting bodies take: beta_T, or all where both conduct
};

// One step of the active lanes of a tile; the rest of `trial` is left for the caller.
void advance_velocity_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                             const double* committed, double* trial, TileOutputs& outputs);
void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs);
void advance_force_driven_flowing(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs);

}  // namespace shearbus::physics
