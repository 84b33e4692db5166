// The step as the interface sees it: with the plastic shear of the host's soft zone in the jump (MODEL.md, "Plastic
// layer"), and along one direction.
#pragma once

#include <optional>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// The plastic shear of the host's soft zone lets the interface of a layer without inertia see the jump
// [V] + sqrt(3) h Ep_dot, DLP (64): links behind this one know no other jump.
class HostShear {
 public:
  // Whether a lane has any.
  static bool acts(const Problem& problem, const TileInputs& inputs);

  HostShear(const Problem& problem, const TileInputs& inputs);

  const TileInputs& inputs() const { return seen_; }
  // Makes of the jumps that the interface has after the step those of the host.
  void leave(const TileInputs& inputs, TileOutputs& outputs) const;

 private:
  TileInputs seen_;
  double shear_[kLanes] = {}, second_shear_[kLanes] = {};  // sqrt(3) h Ep_dot; 0 in open contacts  [m/s]
};

// Slip with two tangential components (MODEL.md, "Two tangential components"). Friction and plasticity are isotropic: the
// step is the scalar step of each active lane along a trial vector, which is the elastic stress (velocity-driven) or the
// frictionless jump (force-driven). inputs() are the inputs of the scalar step, whose answer turn() makes the vectors of
// `trial` and `outputs`.
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

// inputs() are the inputs of the scalar step of the interface, whose answer leave() makes that of the host's step. All
// arguments of the constructor must live until then.
class InterfaceFrame {
 public:
  // Whether the interface may see other inputs than the host sends.
  static bool differs(const ModelOptions& options) {
    return options.tangential_components == 2 || options.plastic_layer;
  }

  InterfaceFrame(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                 const double* committed);
  InterfaceFrame(const InterfaceFrame&) = delete;
  InterfaceFrame& operator=(const InterfaceFrame&) = delete;

  const TileInputs& inputs() const { return scalar_ ? scalar_->inputs() : seen(); }
  void leave(double* trial, TileOutputs& outputs) const;

 private:
  const TileInputs& seen() const { return shear_ ? shear_->inputs() : inputs_; }

  const Problem& problem_;
  const TileInputs& inputs_;
  const double* committed_;
  std::optional<HostShear> shear_;
  std::optional<ScalarStep> scalar_;  // with two tangential components
};

}  // namespace shearbus::physics
