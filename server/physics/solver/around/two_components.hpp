// Slip with two tangential components (MODEL.md, "Two tangential components"). Friction and plasticity are isotropic:
// the step is the scalar step along a trial vector, which is the elastic stress (velocity-driven) or the frictionless
// jump (force-driven).
#pragma once

#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// The scalar step of each active lane along the direction of its trial stress. inputs() are the inputs of the scalar
// step, whose answer turn() makes the vectors of `trial` and `outputs`.
class ScalarStep {
 public:
  ScalarStep(const Problem& problem, const StepOperators& operators, const TileInputs& inputs, const double* committed);
  ScalarStep(const ScalarStep&) = delete;  // inputs() point to stress_old_
  ScalarStep& operator=(const ScalarStep&) = delete;

  const TileInputs& inputs() const { return along_; }
  void turn(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial,
            TileOutputs& outputs) const;

 private:
  TileInputs along_;
  double first_[kLanes] = {}, second_[kLanes] = {};  // direction of each lane, a unit vector
  double stress_old_[kLanes] = {};                   // [Pa]
};

}  // namespace shearbus::physics
