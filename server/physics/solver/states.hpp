// The states of a node. Each state is one member of the list TileLayout, with name, unit and width. Offsets in a tile,
// checkpoint columns and bytes per node follow from this list.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "server/physics/interface/junctions.hpp"
#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/options.hpp"

namespace shearbus::physics {

struct State {
  const char* name;        // name of the checkpoint column
  const char* unit;        // unit in the notation of UDUNITS
  std::size_t offset;      // where the values of the state begin in a tile; they are an array [width][kLanes]
  std::size_t width;       // number of values per node
  bool from_zero = false;  // saved states may lack it: it is then 0, and the next step finds it
};

class StateList {
 public:
  static constexpr std::size_t kAbsent = static_cast<std::size_t>(-1);

  std::span<const State> states() const { return states_; }
  std::size_t doubles = 0;  // number of doubles in a tile, a multiple of kLanes

 protected:
  // Adds a state behind the others and returns its offset. A width of 0 adds nothing and returns kAbsent: this model
  // does not have the state.
  std::size_t add(const char* name, const char* unit, std::size_t width, bool from_zero = false);
  // Adds each state that a law declares, with one value per node. Returns the offset of the first of these states, or
  // kAbsent if the law declares none.
  std::size_t add(std::span<const StateVariable> of_law);

 private:
  std::vector<State> states_;
};

// The list of the states. Each member that is initialised by add() stands for one state: the initialiser declares the
// state, and the member's value is the offset of the state in a tile. Members are initialised in the order of their
// declaration, so the states have this order in the tile.
class TileLayout : public StateList {
  static bool keeps_sticking(const ModelOptions& options);
  static std::span<const StateVariable> friction_states(const ModelOptions& options);
  const ModelOptions* options_;  // for the initialisers of the members only; null after the construction

 public:
  // `modes` is null in a model that stores a temperature profile instead of heat modes.
  TileLayout(const ModelOptions& options, const HeatGrid& heat_grid, const HeatModes* modes, int layer_vertices);

  std::size_t num_hard_vertices;  // vertices of the hard body except z = 0; 0 if the hard body does not conduct
  // With heat modes: number of values before T0, which are the start temperature and one value per mode; else 0.
  std::size_t num_heat_modes;
  // Vertices of the layer and of a half-space behind the layer that have a temperature; with heat modes 1, only z = 0.
  std::size_t num_vertices;
  std::size_t num_strain_vertices;  // number of vertices of a layer that can flow, else 0
  std::size_t num_stress_vertices;  // number of vertices with a stress: with inertia all of the layer, else only z = 0
  // Number of cells of a layer with inertia, force-driven and one for the host's mass behind it; else 0.
  std::size_t num_velocity_cells;

  // The states hard_temperature, heat_modes and temperature follow each other without a gap. Together they are the
  // temperatures of HeatGrid or the values of HeatModes or, while a node sleeps, the amplitudes of HeatBasis.
  std::size_t hard_temperature = add("hard_temperature_k", "K", num_hard_vertices);  // the outermost vertex first
  std::size_t heat_modes = add("heat_modes_k", "K", num_heat_modes);
  std::size_t temperature = add("temperature_k", "K", num_vertices);
  std::size_t plastic_strain = add("plastic_strain", "1", num_strain_vertices);
  // Fraction phi of the work of the imposed jump that heats each vertex (MODEL.md, "Plastic-work heating").
  std::size_t heat_shape = add("heat_shape", "1", options_->taylor_quinney_factor ? num_strain_vertices : 0);
  std::size_t shear_stress = add("shear_stress_pa", "Pa", num_stress_vertices);  // shear stress s, signed
  // Change of the shear stress in the last step over its length, 0 if the layer did not flow: start of the next search.
  std::size_t stress_rate =
      add("shear_stress_rate_pa_per_s", "Pa s-1", num_strain_vertices > 0 && !options_->inertia, true);
  std::size_t layer_velocity = add("layer_velocity_m_per_s", "m s-1", num_velocity_cells);  // relative to the hard body
  std::size_t second_stress = add("second_shear_stress_pa", "Pa", options_->tangential_components == 2);
  std::size_t regime = add("regime", "1", 1);  // Regime of the last step, as a double
  std::size_t sticking =
      add("sticking", "1", keeps_sticking(*options_));  // 1: the last step ended without slip; else 0
  std::size_t junction_strain = add(states_of(options_->junctions));
  std::size_t num_friction_states;                               // number of states of the friction law
  std::size_t friction_state = add(friction_states(*options_));  // states of the friction law
  // Fraction of the metal at each vertex of the soft body that is liquid (MODEL.md, "Melt film").
  std::size_t liquid_fraction = add("liquid_fraction", "1", options_->melt_film ? num_vertices : 0);
  // Two values: the number of steps at rest, and the number of modes that have not decayed (0: the node is awake).
  std::size_t resting = add("resting", "1", nodes_sleep(*options_) ? 2 : 0);
  // For a sleeping node whose layer can flow or melt: the temperature of the hottest vertex; for one whose layer can
  // flow also the plastic strain of the least strained vertex.
  std::size_t hottest_at_rest =
      add("hottest_at_rest_k", "K", nodes_sleep(*options_) && (num_strain_vertices > 0 || options_->melt_film));
  std::size_t least_strain_at_rest =
      add("least_strain_at_rest", "1", nodes_sleep(*options_) && num_strain_vertices > 0);

  // Distance in doubles to the rows of the next tile where tiles stand one behind the other, each with both its
  // buffers, as in the server's shard. Elsewhere memory is asked for in vain, which changes no answer.
  std::ptrdiff_t distance_to_next_tile() const { return 2 * static_cast<std::ptrdiff_t>(doubles); }

  // Offset of the first of the states hard_temperature, heat_modes and temperature (some of which may be absent).
  std::size_t first_temperature() const { return temperature - (num_hard_vertices + num_heat_modes) * kLanes; }
};

}  // namespace shearbus::physics
