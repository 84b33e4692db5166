// The subgrid model of one scene: materials, grid and laws, immutable, shared by all threads. It holds no node's state.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/junctions.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

enum class Strategy { kVelocityDriven, kForceDriven };
enum class Drive { kLayerShear, kInterfaceSlip };
enum class TimeIntegrator { kBackwardEuler, kSdirk2 };

inline constexpr double kShortestControlledStep = 1e-12;  // of a host, where there is a tolerance  [s]
inline constexpr int kMaxInertiaCells = 1000;             // of a layer with inertia: its step works on the stack

struct ModelOptions {
  Strategy strategy = Strategy::kVelocityDriven;
  Material soft;
  Material hard;
  GridOptions grid;
  std::optional<GridOptions> hard_grid;  // the hard body conducts too; absent: it takes its share, 1 - beta_T
  double initial_temperature = 300.0;    // [K]
  TimeIntegrator time_integrator = TimeIntegrator::kBackwardEuler;  // of the heat
  std::optional<ModesOptions> modes;  // force-driven, one body conducts: no profile, of the grid only its depth
  Drive drive = Drive::kLayerShear;   // velocity-driven
  std::optional<double> friction_coefficient;  // velocity-driven: adds s <= mu P
  InterfaceOptions interface;                  // force-driven
  bool plastic_layer = false;                  // force-driven: the layer flows and hardens too
  std::optional<JunctionOptions> junctions;    // force-driven without plastic layer: real contact by junctions

  // Largest error of T0, in parts of what it has to melting at the start. Steps are cut until halving them changes T0
  // by less; not with inertia or taylor_quinney_factor. discretised() gives the grid and the methods that go with it.
  std::optional<double> tolerance;

  int tangential_components = 1;  // of slip and stress: 1, or 2 without INTERFACE_SLIP and inertia

  // Velocity-driven with LAYER_SHEAR, without taylor_quinney_factor, at most kMaxInertiaCells: the stress is a field
  // and the layer's mass is accelerated (DLP 36).
  bool inertia = false;

  // Nodes at rest are not solved (MODEL.md section 3b). Without inertia, modes and SDIRK2, at most kMaxBasisVertices
  // that conduct.
  bool sleep = false;
  // Velocity-driven with LAYER_SHEAR and a conducting hard body: the share of the plastic work that becomes heat, where
  // the layer flows. Absent: all work heats z = 0.
  std::optional<double> taylor_quinney_factor;
};

// The options with a tolerance, and with the grid, heat and time integrator that it asks for (MODEL.md section 3c).
ModelOptions discretised(ModelOptions options, double tolerance);

// Everything that depends on the model and dt but on no node: the factorised heat operator and the response B to unit
// flux (DLP 26-35). Make one per step length and share it.
class StepOperators;

class Model {
 public:
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

  // Energy ledger of that step (MODEL.md section 7b): writes the active lanes of `ledger`, changes no state.
  void record_energy(const StepOperators& operators, const TileInputs& inputs, const TileOutputs& outputs,
                     const double* committed, const double* trial, TileLedger& ledger) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::physics
