// The subgrid model of one scene: materials, grid and laws. A model is immutable, holds no state of a node and may be
// used by several threads at once.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/solver/options.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// Operators that depend on the model and on dt but not on a node: the factorised heat operator and the response B to
// unit flux (DLP 26-35). One object per step length, shared by all nodes and threads.
class StepOperators;

struct Problem;  // the constant part of a model (problem.hpp)

// The vertices of a profile, in ascending z; the same for all nodes of a model.
struct ProfileGrid {
  std::vector<double> position;  // z; below 0 in a conducting hard body  [m]
  std::vector<double> width;     // length that the vertex stands for; at z = 0 that in the soft body  [m]
};

// Where Model::profile() writes the profile of a node: arrays of one value per vertex, in ascending z. Quantities that
// the model lacks, or that are not wanted, have null. NaN: the vertex lies outside of the layer.
struct ProfileRows {
  double* temperature = nullptr;          // T  [K]
  double* plastic_strain = nullptr;       // ep of a layer that can flow
  double* flow_stress = nullptr;          // Y(ep, P, T) of a layer that can flow, at the strain rate 0  [Pa]
  double* shear_stress = nullptr;         // s; uniform in a layer without inertia  [Pa]
  double* second_shear_stress = nullptr;  // second tangential component of s  [Pa]
};

// The masses per area that a force-driven host must give a step of layers with inertia  [kg/m2].
struct LeastMasses {
  double soft, hard;
};

class Model {
 public:
  // Throws RefusedOptions (parts.hpp) where options or laws exclude each other.
  explicit Model(const ModelOptions& options);
  ~Model();
  Model(Model&&) noexcept;

  const ModelOptions& options() const;
  const Grid& grid() const;
  const TileLayout& layout() const;

  // Warnings about this combination of options, one sentence each; for example that the hard body is weaker than the
  // soft body. A text that begins with "note: " informs and needs no action.
  std::vector<std::string> warnings() const;

  // Force-driven with inertia: a closed contact with a half zone of no more mass has no answer in a step of this length.
  LeastMasses least_masses(double dt) const;

  // Interface temperature T0 of the node in one lane, which may be asleep (ModelOptions::sleep)  [K].
  double interface_temperature(const double* tile, int lane) const;

  // The profile of the node in one lane, which may be asleep. A model with heat modes keeps none: it has only T0.
  // `pressure`: P at which the flow stress is evaluated  [Pa].
  bool keeps_profile() const;
  ProfileGrid profile_grid() const;  // of the layer, a conducting hard body, and a half-space behind the layer
  void profile(const double* tile, int lane, double pressure, const ProfileRows& rows) const;

  // Writes the initial states of a tile: no stress, no strain, and each lane uniformly at its `temperature`  [K].
  void initialise(double* tile, const double (&temperature)[kLanes]) const;

  std::shared_ptr<const StepOperators> operators(double dt) const;

  // One step of the active lanes: reads `committed`, writes the whole of `trial` (inactive lanes are copied) and the
  // active lanes of `outputs`. Inputs must be finite, dt and masses > 0; the service checks them. A lane for which no
  // answer is found keeps its state and has the outcome kFailed. Allocates scratch tiles in the first steps of a thread
  // and, with a tolerance, the operators of a shorter step when they are first needed. Throws only if an allocation
  // fails.
  void advance(const StepOperators& operators, const TileInputs& inputs, const double* committed, double* trial,
               TileOutputs& outputs) const;

  // Energy ledger of the step from `committed` to `trial` (MODEL.md, "Energy ledger"): writes the active lanes of
  // `ledger`, changes no state.
  void record_energy(const StepOperators& operators, const TileInputs& inputs, const TileOutputs& outputs,
                     const double* committed, const double* trial, TileLedger& ledger) const;

  // The linearised answer of the step from `committed` to `trial` (MODEL.md, "Linearised answer"): write the active
  // lanes of stress_per_jump and stress_per_pressure, and of time_to_melting, change no state. linearise() is only for
  // options that can_linearise() allows.
  static bool can_linearise(const ModelOptions& options);
  void linearise(const StepOperators& operators, const TileInputs& inputs, const double* committed, const double* trial,
                 TileOutputs& outputs) const;
  void predict_melting(const StepOperators& operators, const TileInputs& inputs, const double* committed,
                       TileOutputs& outputs) const;

 private:
  friend class DividedStep;
  std::unique_ptr<const Problem> problem_;
};

// One step of a tile at a time, as by Model::advance, but in pieces: for a model with a tolerance, whose steps are
// divided into substeps. Which pieces does not change the answer. The model must outlive this object.
class DividedStep {
 public:
  explicit DividedStep(const Model& model);
  DividedStep(DividedStep&&) noexcept;
  ~DividedStep();

  // Begins a step. All arguments must live until the step is done.
  void begin(const StepOperators& operators, const TileInputs& inputs, const double* committed, double* trial,
             TileOutputs& outputs);
  // Goes on until the step is done, which the result tells, or all lanes together have done more than this work, in
  // evaluations. May be called by another thread than before.
  bool run(double work);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::physics
