// One step of a tile under a tolerance, which may be interrupted between two substeps.
#pragma once

#include <optional>

#include "server/physics/solver/around/tolerance.hpp"
#include "server/physics/solver/around/two_components.hpp"

namespace shearbus::physics {

// The first two links of the chain in pipeline.hpp: components and tolerance. All arguments must live until the step is
// done.
class DividedTile {
 public:
  // `accepted`: memory of one tile.
  DividedTile(const Problem& problem, const StepOperators& operators, const TileInputs& inputs, const double* committed,
              double* trial, TileOutputs& outputs, double* accepted);

  // As ControlledStep::run().
  bool run(double work);

 private:
  const Problem& problem_;
  const TileInputs& inputs_;
  const double* committed_;
  double* trial_;
  TileOutputs& outputs_;
  std::optional<ScalarStep> scalar_;  // with two tangential components
  std::optional<ControlledStep> step_;
};

}  // namespace shearbus::physics
