// The step as the interface sees it: with the plastic shear of the host's soft zone in the jump (MODEL.md, "Plastic
// layer"), and along one direction (MODEL.md, "Two tangential components").
#pragma once

#include <optional>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// inputs() are the inputs of the scalar step of the interface, whose answer leave() makes that of the host's step. All
// arguments of the constructor must live until then.
//
// The plastic shear of the host's soft zone lets the interface of a layer without inertia see the jump
// [V] + sqrt(3) h Ep_dot, DLP (64): links behind this one know no other jump. Friction and plasticity are isotropic: a
// step of two tangential components is the scalar step of each active lane along a trial vector, which is the elastic
// stress (velocity-driven) or the frictionless jump (force-driven).
class InterfaceFrame {
 public:
  InterfaceFrame(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                 const double* committed);
  InterfaceFrame(const InterfaceFrame&) = delete;  // inputs() point to stress_old_
  InterfaceFrame& operator=(const InterfaceFrame&) = delete;

  const TileInputs& inputs() const { return along_ ? *along_ : sheared_ ? *sheared_ : inputs_; }
  void leave(double* trial, TileOutputs& outputs) const;

 private:
  void add_host_shear();
  void look_along_one_direction(const StepOperators& operators);
  void turn_back(double* trial, TileOutputs& outputs) const;
  // The inputs with the host's shear.
  const TileInputs& seen() const { return sheared_ ? *sheared_ : inputs_; }

  const Problem& problem_;
  const TileInputs& inputs_;
  const double* committed_;
  std::optional<TileInputs> sheared_;      // with the host's shear, where a lane has any
  std::optional<TileInputs> along_;        // with two tangential components: along the direction of each lane
  double shear_[2][kLanes];                // components of sqrt(3) h Ep_dot; 0 in open contacts  [m/s]
  double first_[kLanes], second_[kLanes];  // direction of each lane, a unit vector
  double stress_old_[kLanes];              // along it  [Pa]
};

}  // namespace shearbus::physics
