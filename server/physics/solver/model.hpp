// The subgrid model of one scene: materials, grid and laws, immutable, shared by all threads. It holds no node's state.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/solver/options.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// Everything that depends on the model and dt but on no node: the factorised heat operator and the response B to unit
// flux (DLP 26-35). Make one per step length and share it.
class StepOperators;

class Model {
 public:
  // Throws RefusedOptions (parts.hpp) where options or laws exclude each other.
  explicit Model(const ModelOptions& options);
  ~Model();
  Model(Model&&) noexcept;

  const ModelOptions& options() const;
  const Grid& grid() const;
  const TileLayout& layout() const;

  // Things a user should know about this combination, one sentence each (hard side weaker than soft, ...).
  std::vector<std::string> warnings() const;

  // T0 of one lane, which a sleeper's state does not show  [K].
  double interface_temperature(const double* tile, int lane) const;

  // States of a tile before the first step: temperature uniform, one value per lane.
  void initialise(double* tile, const double (&temperature)[kLanes]) const;

  std::shared_ptr<const StepOperators> operators(double dt) const;

  // One step of the active lanes: reads `committed`, writes the whole of `trial` (inactive lanes are copied) and the
  // active lanes of `outputs`. Never allocates, but once in a thread. Inputs are finite, dt > 0, masses > 0: the
  // service has checked.
  void advance(const StepOperators& operators, const TileInputs& inputs, const double* committed, double* trial,
               TileOutputs& outputs) const;

  // Energy ledger of that step (MODEL.md, "Energy ledger"): writes the active lanes of `ledger`, changes no state.
  void record_energy(const StepOperators& operators, const TileInputs& inputs, const TileOutputs& outputs,
                     const double* committed, const double* trial, TileLedger& ledger) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::physics
