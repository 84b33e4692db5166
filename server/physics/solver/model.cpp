#include "server/physics/solver/model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/around/tolerance.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

// Largest number of times that a force-driven step is halved because it may have several answers. slip_is_unique() is
// true if a bound with the factors B0 and b is below 1. B0 falls as sqrt(dt) and b as dt, so each halving makes the
// bound about 2^1.5 times smaller; six make it about 512 times smaller.
constexpr int kMaxHalvings = 6;

HeatGrid make_heat_grid(const ModelOptions& options, const Grid& layer) {
  if (!options.hard_grid) return HeatGrid(layer, options.grid.far_boundary);
  return HeatGrid(layer, options.grid.far_boundary, Grid(*options.hard_grid), options.hard_grid->far_boundary);
}

// The interface law of the options. A velocity-driven interface has no yield limit of its own (junctions have theirs),
// and friction only if the options give a coefficient.
InterfaceOptions interface_of(const ModelOptions& options) {
  if (options.strategy == Strategy::kForceDriven) return options.interface;
  constexpr double kUnlimited = std::numeric_limits<double>::infinity();
  InterfaceOptions law = has_friction(options) ? options.interface : InterfaceOptions {};
  law.friction_coefficient = options.friction_coefficient.value_or(kUnlimited);
  law.yield_strength = kUnlimited;
  return law;
}

// Returns the options. Throws RefusedOptions where options exclude each other.
const ModelOptions& possible(const ModelOptions& options) {
  if (std::vector<Refusal> found = refusals(options); !found.empty()) throw RefusedOptions(std::move(found));
  return options;
}

}  // namespace

Problem::Problem(const ModelOptions& model_options)
    : options(model_options),
      interface(interface_of(model_options)),
      grid(model_options.grid),
      heat_grid(make_heat_grid(model_options, grid)),
      modes(model_options.modes
                ? std::optional<HeatModes>(std::in_place, HeatKernel(model_options.soft, model_options.grid),
                                           *model_options.modes)
                : std::nullopt),
      layout(model_options, heat_grid, modes ? &*modes : nullptr, grid.num_vertices()),
      basis(nodes_sleep(model_options)
                ? std::optional<HeatBasis>(std::in_place, heat_grid, model_options.soft, model_options.hard)
                : std::nullopt),
      steps_before_sleep(physics::steps_before_sleep(heat_grid.num_vertices())),
      heat_rows(modes ? modes->num_rows() : heat_grid.num_vertices()),
      heat_partition(model_options.hard_grid ? 1.0 : physics::heat_partition(model_options.soft, model_options.hard)),
      heat_varies(conducts_by_temperature(model_options)) {
  // A tolerance does not divide the step of a sleeping node, which therefore must have no error in time.
  if (basis) basis->exact_in_time = model_options.tolerance.has_value();
}

Model::Model(const ModelOptions& options) : problem_(std::make_unique<const Problem>(possible(options))) {}
Model::~Model() = default;
Model::Model(Model&&) noexcept = default;

const ModelOptions& Model::options() const {
  return problem_->options;
}
const Grid& Model::grid() const {
  return problem_->grid;
}
const TileLayout& Model::layout() const {
  return problem_->layout;
}

std::vector<std::string> Model::warnings() const {
  const ModelOptions& o = problem_->options;
  std::vector<std::string> warnings;
  const double hard_yield = fresh_strength(o.hard), soft_yield = fresh_strength(o.soft);
  if (hard_yield < soft_yield) {
    warnings.push_back(text_of("the hard body's yield strength (", hard_yield, " Pa) is below the soft body's (",
                               soft_yield, " Pa): the layer that flows should be the weaker body, name it soft"));
  }
  const auto warn_of_far_face = [&](const char* where, const GridOptions& grid, double diffusivity, const char* body,
                                    const char* key) {
    if (grid.far_boundary != FarBoundary::kInsulated) return;
    const double h = grid.thickness;
    warnings.push_back(text_of("note: ", where, ": heat reaches it (h = 3 sqrt(alpha t)) after ",
                               Digits{3, h * h / (9.0 * diffusivity)}, " s, for longer runs take a thicker ", body,
                               " than ", h, " m or ", key, " = \"half_space\""));
  };
  warn_of_far_face("the far face is insulated", o.grid, o.soft.diffusivity, "layer", "far_boundary");
  if (o.hard_grid)
    warn_of_far_face("the hard body ends at an insulated face", *o.hard_grid, o.hard.diffusivity, "hard layer",
                     "hard_layer.far_boundary");
  if (o.hard_grid && o.hard.melting_temperature < o.soft.melting_temperature) {
    warnings.push_back(text_of("the hard body melts at ", o.hard.melting_temperature, " K, below the soft body's ",
                               o.soft.melting_temperature, " K: it is heated as if it stayed solid"));
  }
  if (o.taylor_quinney_factor) {
    warnings.emplace_back(
        "note: plastic work heats the layer: once it softens faster than it hardens the flow gathers in a band, and "
        "where and when that forms depends on cells and dt; compare several before trusting the stress after it");
  }
  if (o.time_integrator == TimeIntegrator::kSdirk2 && only_open_is_second_order(o))
    warnings.emplace_back(
        "note: layer.time_integrator = \"sdirk2\" makes the steps of open contacts second order only: with these "
        "options "
        "slip and flow are constant over a step, which the outcome of a node reports as \"first order\"");
  if (o.tolerance)
    warnings.push_back("note: " + discretisation_of(o, problem_->modes ? problem_->modes->rate.size() : 0));
  constexpr double kCostlyStep = 3e5, kCostlyControlledStep = 3e7;  // about 3 ms and 0.3 s of a core
  if (const double work = hard_step_work(*problem_); work > (o.tolerance ? kCostlyControlledStep : kCostlyStep)) {
    warnings.push_back(text_of("note: costly: a step may need ", Digits{2, work},
                               " evaluations of a cell for each node, of which a core makes some 1e8 a second; ",
                               o.tolerance ? "a larger tolerance needs fewer cells and substeps"
                                           : "fewer cells, graded towards the interface, need less"));
  }
  if (o.initial_temperature >= o.soft.melting_temperature) {
    warnings.push_back(text_of("the initial temperature (", o.initial_temperature,
                               " K) is not below the soft body's melting temperature (", o.soft.melting_temperature,
                               " K): the layer carries no stress"));
  }
  if (o.junctions && o.junctions->metal.yield_strength_max < o.junctions->metal.yield_strength) {
    warnings.push_back(text_of("the junctions' saturation strength (", o.junctions->metal.yield_strength_max,
                               " Pa) is below the interface's yield strength (", o.junctions->metal.yield_strength,
                               " Pa): they do not harden"));
  }
  if ((o.strategy == Strategy::kVelocityDriven || o.plastic_layer) &&
      strength_ceiling(o.soft) < o.soft.yield_strength) {
    warnings.push_back(text_of("the saturation strength (", o.soft.yield_strength_max,
                               " Pa) is below the yield strength (", o.soft.yield_strength,
                               " Pa): the layer does not harden"));
  }
  return warnings;
}

void Model::initialise(double* tile, const double (&temperature)[kLanes]) const {
  const TileLayout& layout = problem_->layout;
  std::fill_n(tile, layout.doubles, 0.0);  // 0 means no strain, no stress, Regime::kOpen
  if (layout.heat_modes != TileLayout::kAbsent) {
    std::copy_n(temperature, kLanes, tile + layout.heat_modes);
    std::copy_n(temperature, kLanes, tile + layout.temperature);
    return;
  }
  for (std::size_t i = 0; i < layout.num_hard_vertices + layout.num_vertices; ++i) {
    std::copy_n(temperature, kLanes, tile + layout.first_temperature() + i * kLanes);
  }
  if (layout.liquid_fraction != TileLayout::kAbsent) {
    for (std::size_t i = 0; i < layout.num_vertices * kLanes; ++i)
      tile[layout.liquid_fraction + i] =
          temperature[i % kLanes] > problem_->options.soft.melting_temperature ? 1.0 : 0.0;
  }
  if (layout.heat_shape == TileLayout::kAbsent) return;
  // heat_shape (share of the plastic work that heats each vertex) begins as in a layer that flows uniformly.
  for (std::size_t i = 0; i < layout.num_strain_vertices; ++i) {
    const double share = problem_->grid.weight[i] / problem_->grid.vertex.back();
    std::fill_n(tile + layout.heat_shape + i * kLanes, kLanes, *problem_->options.taylor_quinney_factor * share);
  }
}

std::unique_ptr<StepOperators> make_operators(const Problem& problem, double dt, int times) {
  const ModelOptions& options = problem.options;
  const bool stages = options.time_integrator == TimeIntegrator::kSdirk2;
  const double step = std::ldexp(dt, -times);
  const int halvings = options.strategy == Strategy::kForceDriven ? std::max(0, kMaxHalvings - times) : 0;
  if (problem.modes) return std::make_unique<StepOperators>(*problem.modes, step, halvings, stages);
  auto made = std::make_unique<StepOperators>(problem.grid, problem.heat_grid, options.soft, options.hard, step,
                                              halvings, options.taylor_quinney_factor.has_value(), stages,
                                              problem.basis ? &*problem.basis : nullptr);
  if (options.tolerance && options.plastic_layer && !problem.heat_varies) made->make_even();
  return made;
}

std::shared_ptr<const StepOperators> Model::operators(double dt) const {
  const auto make = [problem = problem_.get(), dt](int times) { return make_operators(*problem, dt, times); };
  std::unique_ptr<StepOperators> operators = make(0);
  if (problem_->options.tolerance) operators->allow_halving(most_times_halved(dt), make);
  return operators;
}

}  // namespace shearbus::physics
