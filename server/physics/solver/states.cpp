#include "server/physics/solver/states.hpp"

#include "server/physics/interface/friction_laws.hpp"

namespace shearbus::physics {

std::size_t StateList::add(const char* name, const char* unit, std::size_t width, bool from_zero) {
  if (width == 0) return kAbsent;
  states_.push_back({name, unit, doubles, width, from_zero});
  doubles += width * kLanes;
  return states_.back().offset;
}

std::size_t StateList::add(std::span<const StateVariable> of_law) {
  const std::size_t first = doubles;
  for (const StateVariable& state : of_law) add(state.name, state.unit, 1);
  return of_law.empty() ? kAbsent : first;
}

// Rigid, a force-driven interface sticks where its regime says so. Next to a layer that flows the regime is that of the
// flow.
bool TileLayout::keeps_sticking(const ModelOptions& options) {
  return options.plastic_layer || (options.strategy == Strategy::kVelocityDriven && has_friction(options) &&
                                   properties_of(options.interface.friction_law).falls_with_slip);
}

std::span<const StateVariable> TileLayout::friction_states(const ModelOptions& options) {
  return has_friction(options) ? states_of(options.interface.friction_law) : std::span<const StateVariable>{};
}

TileLayout::TileLayout(const ModelOptions& options, const HeatGrid& heat_grid, const HeatModes* modes,
                       int layer_vertices)
    : options_(&options),
      num_hard_vertices(modes != nullptr ? 0 : static_cast<std::size_t>(heat_grid.interface)),
      num_heat_modes(modes != nullptr ? static_cast<std::size_t>(modes->num_rows()) - 1 : 0),
      num_vertices(modes != nullptr ? 1 : static_cast<std::size_t>(heat_grid.num_vertices()) - num_hard_vertices),
      num_strain_vertices(options.strategy == Strategy::kVelocityDriven || options.plastic_layer
                              ? static_cast<std::size_t>(layer_vertices)
                              : 0),
      num_stress_vertices(options.inertia ? static_cast<std::size_t>(layer_vertices) : 1),
      num_velocity_cells(num_stress_vertices - 1 +
                         (options.inertia && options.strategy == Strategy::kForceDriven ? 1 : 0)),
      num_friction_states(friction_states(options).size()) {
  options_ = nullptr;
}

}  // namespace shearbus::physics
