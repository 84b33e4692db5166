// Options of a model, which a scene chooses.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/junctions.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/material/heat_table.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

enum class Strategy { kVelocityDriven, kForceDriven };
enum class Drive { kLayerShear, kInterfaceSlip };
enum class TimeIntegrator { kBackwardEuler, kSdirk2 };

inline constexpr double kShortestControlledStep = 1e-12;  // shortest dt of a host if the model has a tolerance  [s]
// Default of ModelOptions::work_budget, which takes a core some seconds  [evaluations].
inline constexpr double kWorkBudget = 3e8;
// Largest number of cells of a layer with inertia: the arrays of its step are on the stack.
inline constexpr int kMaxInertiaCells = 1000;
inline constexpr int kMaxSleepCells = 900;  // largest number of cells of both bodies together in a model with sleep
// A far boundary "half_space" adds at most 49 vertices to a body: each added cell is 1.3 times as wide as the cell
// before it, down to a depth of 1000 layer thicknesses.
static_assert(kMaxSleepCells + 2 * 125 <= kMaxBasisVertices);

// A film of molten metal at the interface (MODEL.md, "Melt film").
struct MeltFilmOptions {
  double latent_heat = 0.0;        // latent heat of fusion L of the soft body  [J/kg]
  double viscosity = 0.0;          // eta of the liquid at its melting temperature  [Pa s]
  double activation_energy = 0.0;  // E of eta(T) = eta exp(E/R (1/T - 1/T_melt)); 0: constant viscosity  [J/mol]
};

struct ModelOptions {
  Strategy strategy = Strategy::kVelocityDriven;
  Material soft;
  Material hard;
  std::shared_ptr<const HeatTables> heat_tables;  // tables of k(T) and c(T); null: none
  GridOptions grid;
  // Grid of a conducting hard body. Absent: the hard body gets the fixed share 1 - beta_T of the friction heat.
  std::optional<GridOptions> hard_grid;
  double initial_temperature = 300.0;                               // [K]
  TimeIntegrator time_integrator = TimeIntegrator::kBackwardEuler;  // time integrator of the heat equation
  // Absent: the temperature is a profile on the grid. Present: a sum of exponentials replaces the profile; only
  // force-driven, with one conducting body.
  std::optional<ModesOptions> modes;
  Drive drive = Drive::kLayerShear;  // velocity-driven: whether the jump [V] or the host's shear rate shears the layer
  // Velocity-driven: mu of the law in `interface`, which limits the shear stress; absent: no friction limits it.
  std::optional<double> friction_coefficient;
  InterfaceOptions interface;                // law of the interface; velocity-driven it has no yield strength
  bool plastic_layer = false;                // force-driven: in addition to the slip, the layer flows and hardens
  std::optional<JunctionOptions> junctions;  // the bodies touch only at junctions
  // The soft body melts at z = 0 and the melt carries the stress. Only force-driven with a conducting hard body. Absent:
  // friction vanishes as the interface approaches T_melt, and nothing melts.
  std::optional<MeltFilmOptions> melt_film;

  // Largest error of T0 relative to T_melt - initial_temperature. A step is divided into substeps until its estimated
  // error is smaller. Absent: steps are not divided for accuracy. discretised() chooses a grid and methods that fit.
  std::optional<double> tolerance;

  // Largest work of a node in one step, in evaluations (work.hpp). A step under a tolerance that needs more ends
  // without an answer (kOverBudget).
  double work_budget = kWorkBudget;

  int tangential_components = 1;  // components of slip and stress: 1 or 2; 2 not with INTERFACE_SLIP or inertia

  // The layer has mass, so its stress varies with z, DLP (36). Only in a layer that flows, force-driven or with
  // LAYER_SHEAR, and with at most kMaxInertiaCells cells.
  bool inertia = false;

  // Nodes at rest sleep: their temperatures follow from eigenmodes of heat conduction, and no step is solved
  // (METHODS.md). Needs at most kMaxSleepCells cells.
  bool sleep = false;
  // Fraction of the plastic work that becomes heat at the flowing vertices. Only with a conducting hard body, and
  // velocity-driven with LAYER_SHEAR or force-driven with a plastic layer. Absent: velocity-driven the work of the whole
  // jump becomes heat at z = 0, force-driven plastic work heats nothing.
  std::optional<double> taylor_quinney_factor;
};

// The tables of k(T) and c(T): empty ones where the options have none.
inline const HeatTables& heat_tables(const ModelOptions& options) {
  static const HeatTables none;
  return options.heat_tables != nullptr ? *options.heat_tables : none;
}

// Whether k or c of a conducting body follows the temperature.
inline bool conducts_by_temperature(const ModelOptions& options) {
  return options.heat_tables != nullptr || options.soft.conducts_by_temperature() ||
         options.hard.conducts_by_temperature();
}

// Whether nodes of the model may sleep. With heat modes no node does: its step at rest costs as little as that of a
// sleeping node. Nor does one with k(T) or c(T): its heat has no modes.
inline bool nodes_sleep(const ModelOptions& options) {
  return options.sleep && !options.modes && !conducts_by_temperature(options);
}

// Whether only open contacts take steps of second order with the integrator of these options: a part takes the slip or
// the flow of a step as constant, so that a step with slip or flow is one of backward Euler (METHODS.md).
bool only_open_is_second_order(const ModelOptions& options);

// Velocity-driven: whether the jump is slip of the interface, and the host's own shear drives the layer, DLP (64).
inline bool jump_is_slip(const ModelOptions& options) {
  return options.strategy == Strategy::kVelocityDriven && options.drive == Drive::kInterfaceSlip;
}

// Whether a friction law acts at the interface.
inline bool has_friction(const ModelOptions& options) {
  return options.strategy == Strategy::kForceDriven || options.friction_coefficient.has_value();
}

// Returns the options with the given tolerance and with the grid, heat method and time integrator chosen for that
// tolerance (METHODS.md).
ModelOptions discretised(ModelOptions options, double tolerance);
// Describes the grid and the methods of a model with a tolerance for the user, in one sentence. `modes`: number of heat
// modes, 0 with a temperature profile.
std::string discretisation_of(const ModelOptions& options, std::size_t modes);

}  // namespace shearbus::physics
