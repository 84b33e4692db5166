#include "server/physics/solver/model.hpp"

#include <algorithm>
#include <cmath>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/around/ledger.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

// Halvings of dt the force-driven solver may take where a step has several answers. Each makes the criterion's left
// side 2^1.5 smaller: six make it 512 times smaller.
constexpr int kMaxHalvings = 6;

TileLayout make_layout(const ModelOptions& options, const HeatGrid& heat_grid, const HeatModes* modes,
                       int layer_vertices) {
  TileLayout layout;
  if (modes != nullptr) {
    layout.num_vertices = 1;
    layout.num_heat_modes = static_cast<std::size_t>(modes->num_rows()) - 1;
    layout.heat_modes = 0;
    layout.temperature = layout.num_heat_modes * kLanes;
  } else {
    layout.num_hard_vertices = static_cast<std::size_t>(heat_grid.interface);
    layout.num_vertices = static_cast<std::size_t>(heat_grid.num_vertices()) - layout.num_hard_vertices;
    if (layout.num_hard_vertices > 0) layout.hard_temperature = 0;
    layout.temperature = layout.num_hard_vertices * kLanes;
  }
  layout.doubles = layout.temperature + layout.num_vertices * kLanes;
  if (options.strategy == Strategy::kVelocityDriven || options.plastic_layer) {
    layout.plastic_strain = layout.doubles;
    layout.num_strain_vertices = static_cast<std::size_t>(layer_vertices);
    layout.doubles += layout.num_strain_vertices * kLanes;
  }
  if (options.taylor_quinney_factor) {
    layout.heat_shape = layout.doubles;
    layout.doubles += layout.num_strain_vertices * kLanes;
  }
  if (options.inertia) {
    layout.num_stress_vertices = static_cast<std::size_t>(layer_vertices);
    layout.num_velocity_cells = layout.num_stress_vertices - 1;
  }
  layout.shear_stress = layout.doubles;
  layout.doubles += layout.num_stress_vertices * kLanes;
  if (options.inertia) {
    layout.layer_velocity = layout.doubles;
    layout.doubles += layout.num_velocity_cells * kLanes;
  }
  if (options.tangential_components == 2) {
    layout.second_stress = layout.doubles;
    layout.doubles += kLanes;
  }
  layout.regime = layout.doubles;
  layout.doubles += kLanes;
  if (options.plastic_layer) {
    layout.sticking = layout.doubles;
    layout.doubles += kLanes;
  }
  if (options.junctions) {
    layout.junction_strain = layout.doubles;
    layout.doubles += kLanes;
  }
  if (options.sleep) {
    layout.resting = layout.doubles;
    layout.doubles += std::size_t{2} * kLanes;
  }
  if (options.sleep && layout.plastic_strain != TileLayout::kAbsent) {
    layout.weakest = layout.doubles;
    layout.doubles += std::size_t{2} * kLanes;
  }
  return layout;
}

HeatGrid make_heat_grid(const ModelOptions& options, const Grid& layer) {
  if (!options.hard_grid) return HeatGrid(layer, options.grid.far_boundary);
  return HeatGrid(layer, options.grid.far_boundary, Grid(*options.hard_grid), options.hard_grid->far_boundary);
}

}  // namespace

Problem::Problem(const ModelOptions& model_options)
    : options(model_options),
      grid(model_options.grid),
      heat_grid(make_heat_grid(model_options, grid)),
      modes(model_options.modes
                ? std::optional<HeatModes>(std::in_place, HeatKernel(model_options.soft, model_options.grid),
                                           *model_options.modes)
                : std::nullopt),
      layout(make_layout(model_options, heat_grid, modes ? &*modes : nullptr, grid.num_vertices())),
      basis(model_options.sleep
                ? std::optional<HeatBasis>(std::in_place, heat_grid, model_options.soft, model_options.hard)
                : std::nullopt),
      steps_before_sleep(physics::steps_before_sleep(heat_grid.num_vertices())),
      heat_rows(modes ? modes->num_rows() : heat_grid.num_vertices()),
      heat_partition(model_options.hard_grid ? 1.0 : physics::heat_partition(model_options.soft, model_options.hard)) {}

struct Model::Impl : Problem {
  using Problem::Problem;
};

Model::Model(const ModelOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Model::~Model() = default;
Model::Model(Model&&) noexcept = default;

const ModelOptions& Model::options() const {
  return impl_->options;
}
const Grid& Model::grid() const {
  return impl_->grid;
}
const TileLayout& Model::layout() const {
  return impl_->layout;
}

std::vector<std::string> Model::warnings() const {
  const ModelOptions& o = impl_->options;
  std::vector<std::string> warnings;
  if (o.hard.yield_strength < o.soft.yield_strength) {
    warnings.push_back(text_of("the hard body's yield strength (", o.hard.yield_strength,
                               " Pa) is below the soft body's (", o.soft.yield_strength,
                               " Pa): the layer that flows should be the weaker body, name it soft"));
  }
  if (o.grid.far_boundary == FarBoundary::kInsulated) {
    const double h = o.grid.thickness;
    warnings.push_back(text_of("the far face is insulated: heat reaches it (h = 3 sqrt(alpha t)) after ",
                               Digits{3, h * h / (9.0 * o.soft.diffusivity)},
                               " s, for longer runs take a thicker layer than ", h,
                               " m or far_boundary = \"half_space\""));
  }
  if (o.hard_grid && o.hard_grid->far_boundary == FarBoundary::kInsulated) {
    const double h = o.hard_grid->thickness;
    warnings.push_back(text_of("the hard body ends at an insulated face: heat reaches it (h = 3 sqrt(alpha t)) after ",
                               Digits{3, h * h / (9.0 * o.hard.diffusivity)},
                               " s, for longer runs take a thicker hard layer than ", h,
                               " m or hard_layer.far_boundary = \"half_space\""));
  }
  if (o.hard_grid && o.hard.melting_temperature < o.soft.melting_temperature) {
    warnings.push_back(text_of("the hard body melts at ", o.hard.melting_temperature, " K, below the soft body's ",
                               o.soft.melting_temperature, " K: it is heated as if it stayed solid"));
  }
  if (o.taylor_quinney_factor) {
    warnings.emplace_back(
        "plastic work heats the layer: once it softens faster than it hardens the flow gathers in a band, and where "
        "and "
        "when that forms depends on cells and dt; compare several before trusting the stress after it");
  }
  if (o.tolerance) warnings.push_back(discretisation_of(o, impl_->modes ? impl_->modes->rate.size() : 0));
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

double Model::interface_temperature(const double* tile, int lane) const {
  return physics::interface_temperature(*impl_, tile, lane);
}

void Model::initialise(double* tile, const double (&temperature)[kLanes]) const {
  const TileLayout& layout = impl_->layout;
  std::fill_n(tile, layout.doubles, 0.0);  // no strain, no stress, Regime::kOpen
  if (layout.heat_modes != TileLayout::kAbsent) {
    std::copy_n(temperature, kLanes, tile + layout.heat_modes);
    std::copy_n(temperature, kLanes, tile + layout.temperature);
    return;
  }
  for (std::size_t i = 0; i < layout.num_hard_vertices + layout.num_vertices; ++i) {
    std::copy_n(temperature, kLanes, tile + layout.first_temperature() + i * kLanes);
  }
  if (layout.heat_shape == TileLayout::kAbsent) return;
  // Until it has flowed, as a uniform layer would: evenly.
  for (std::size_t i = 0; i < layout.num_strain_vertices; ++i) {
    const double share = impl_->grid.weight[i] / impl_->grid.vertex.back();
    std::fill_n(tile + layout.heat_shape + i * kLanes, kLanes, *impl_->options.taylor_quinney_factor * share);
  }
}

std::shared_ptr<const StepOperators> Model::operators(double dt) const {
  // `times`: the step is itself one so often halved, and no substep taken where an answer has a choice becomes shorter
  // than the shortest of the whole one.
  const auto make = [problem = static_cast<const Problem*>(impl_.get()), dt](int times) {
    const ModelOptions& options = problem->options;
    const bool stages = options.time_integrator == TimeIntegrator::kSdirk2;
    const double step = std::ldexp(dt, -times);
    const int halvings = options.strategy == Strategy::kForceDriven ? std::max(0, kMaxHalvings - times) : 0;
    if (problem->modes) return std::make_unique<StepOperators>(*problem->modes, step, halvings, stages);
    return std::make_unique<StepOperators>(problem->grid, problem->heat_grid, options.soft, options.hard, step,
                                           halvings, options.taylor_quinney_factor.has_value(), stages,
                                           problem->basis ? &*problem->basis : nullptr);
  };
  std::unique_ptr<StepOperators> operators = make(0);
  if (impl_->options.tolerance) operators->allow_halving(most_times_halved(dt), make);
  return operators;
}

void keep_lane(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial, int lane,
               TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  copy_lane(committed, trial, layout.doubles, lane);
  outputs.shear_stress[lane] = committed[layout.shear_stress + lane];
  outputs.sliding_velocity[lane] = 0.0;
  outputs.velocity_jump_new[lane] = inputs.velocity_jump[lane];
  outputs.interface_temperature[lane] = interface_temperature(problem, committed, lane);
  outputs.friction_heat[lane] = 0.0;
  outputs.regime[lane] = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));
  outputs.outcome[lane] = kFailed;
}

void advance_once(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                  const double* committed, double* trial, TileOutputs& outputs) {
  const bool sdirk2 = problem.options.time_integrator == TimeIntegrator::kSdirk2;
  const AdvanceTile awake = problem.options.inertia ? advance_with_inertia
                            : problem.options.strategy == Strategy::kVelocityDriven
                                ? (sdirk2 ? advance_velocity_driven_sdirk2 : advance_velocity_driven)
                            : problem.options.plastic_layer ? advance_force_driven_flowing
                            : sdirk2                        ? advance_force_driven_sdirk2
                                                            : advance_force_driven;
  if (problem.basis) {
    advance_with_sleep(problem, operators, awake, inputs, committed, trial, outputs);
  } else {
    awake(problem, operators, inputs, committed, trial, outputs);
  }
  for (int lane = 0; lane < kLanes; ++lane) {
    if (!contains(inputs.active, lane)) {
      copy_lane(committed, trial, problem.layout.doubles, lane);
    } else if (!std::isfinite(outputs.shear_stress[lane]) || !std::isfinite(outputs.interface_temperature[lane]) ||
               !std::isfinite(outputs.sliding_velocity[lane]) || !std::isfinite(outputs.velocity_jump_new[lane]) ||
               !std::isfinite(outputs.friction_heat[lane])) {
      // No root was found, the arithmetic left the range of a double, or the old state was no number: no answer.
      keep_lane(problem, inputs, committed, trial, lane, outputs);
    }
  }
}

void advance_along(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                   const double* committed, double* trial, TileOutputs& outputs) {
  (problem.options.tolerance ? advance_controlled : advance_once)(problem, operators, inputs, committed, trial,
                                                                  outputs);
}

void Model::advance(const StepOperators& operators, const TileInputs& inputs, const double* committed, double* trial,
                    TileOutputs& outputs) const {
  const auto step = impl_->options.tangential_components == 2 ? advance_two_components : advance_along;
  step(*impl_, operators, inputs, committed, trial, outputs);
}

void Model::record_energy(const StepOperators& operators, const TileInputs& inputs, const TileOutputs& outputs,
                          const double* committed, const double* trial, TileLedger& ledger) const {
  physics::record_energy(*impl_, operators.dt(), inputs, outputs, committed, trial, ledger);
}

}  // namespace shearbus::physics
