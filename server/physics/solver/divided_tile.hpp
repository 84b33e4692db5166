// One step of a tile under a tolerance, which may be interrupted between two substeps.
#pragma once

#include "server/physics/solver/around/interface_frame.hpp"
#include "server/physics/solver/around/tolerance.hpp"

namespace shearbus::physics {

// The first two links of the chain in pipeline.hpp: frame and tolerance. All arguments must live until the step is done.
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
  double* trial_;
  TileOutputs& outputs_;
  InterfaceFrame frame_;
  ControlledStep step_;
};

}  // namespace shearbus::physics
