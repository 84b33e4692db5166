// Options of a model, which a scene chooses.
#pragma once

#include <optional>

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/junctions.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

enum class Strategy { kVelocityDriven, kForceDriven };
enum class Drive { kLayerShear, kInterfaceSlip };
enum class TimeIntegrator { kBackwardEuler, kSdirk2 };

inline constexpr double kShortestControlledStep = 1e-12;  // shortest dt of a host if the model has a tolerance  [s]
// Default of ModelOptions::work_budget: some seconds of one core.
inline constexpr double kWorkBudget = 3e8;
inline constexpr int kMaxInertiaCells = 1000;  // most cells of a layer with inertia, whose step works on the stack
inline constexpr int kMaxSleepCells = 900;     // most cells of both bodies together in a model with sleep
// A far boundary "half_space" adds at most 49 vertices to a body: each added cell is 1.3 times as wide as the cell
// before it, down to a depth of 1000 layer thicknesses.
static_assert(kMaxSleepCells + 2 * 50 <= kMaxBasisVertices);

struct ModelOptions {
  Strategy strategy = Strategy::kVelocityDriven;
  Material soft;
  Material hard;
  GridOptions grid;
  std::optional<GridOptions> hard_grid;  // grid of a conducting hard body; absent: the body gets 1 - beta_T of the heat
  double initial_temperature = 300.0;    // [K]
  TimeIntegrator time_integrator = TimeIntegrator::kBackwardEuler;  // time integrator of the heat equation
  std::optional<ModesOptions> modes;  // force-driven with one conducting body: heat by modes, which replace the cells
  Drive drive = Drive::kLayerShear;   // velocity-driven: what shears the layer
  std::optional<double> friction_coefficient;  // velocity-driven: adds the limit s <= mu P
  InterfaceOptions interface;                  // force-driven: law of the interface
  bool plastic_layer = false;                  // force-driven: in addition to the slip, the layer flows and hardens
  std::optional<JunctionOptions> junctions;    // force-driven without plastic layer: the bodies touch only at junctions

  // Largest error of T0 relative to T_melt - initial_temperature. Steps are divided until the estimated error is
  // smaller. discretised() gives the grid and the methods for a tolerance.
  std::optional<double> tolerance;

  // Most work of a node in one step, in evaluations (work.hpp). A step under a tolerance that needs more ends without an
  // answer (kOverBudget).
  double work_budget = kWorkBudget;

  int tangential_components = 1;  // components of slip and stress: 1, or 2 without INTERFACE_SLIP and inertia

  // The layer has mass: its stress is a field (DLP 36). Velocity-driven with LAYER_SHEAR, at most kMaxInertiaCells.
  bool inertia = false;

  // Nodes at rest sleep: their temperatures follow from modes, and no step is solved (METHODS.md). Needs at most
  // kMaxSleepCells cells.
  bool sleep = false;
  // Fraction of the plastic work that becomes heat, where the layer flows. Velocity-driven with LAYER_SHEAR and a
  // conducting hard body. Absent: all work heats z = 0.
  std::optional<double> taylor_quinney_factor;
};

// Returns the options with the given tolerance and with the grid, heat method and time integrator chosen for that
// tolerance (METHODS.md).
ModelOptions discretised(ModelOptions options, double tolerance);

}  // namespace shearbus::physics
