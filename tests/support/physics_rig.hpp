// A model with one tile of states for tests. It sets inputs, takes steps and reads the states of lanes.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/advance_one.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::testing {

using namespace shearbus::physics;  // the tests of the physics use its names unqualified

inline ModelOptions paper_options(Strategy strategy = Strategy::kVelocityDriven) {
  ModelOptions options;
  options.strategy = strategy;
  options.soft = make_material("aluminium_dlp", {}).material;
  options.hard = make_material("steel_dlp", {}).material;
  options.interface = {0.3, 200e6};
  return options;
}

// Returns the options with a conducting hard body. Its default grid is the layer's grid scaled by the square root of
// the ratio of the thermal diffusivities, hard to soft, so that heat penetrates the same number of cells on both sides.
inline ModelOptions two_sided(ModelOptions options, std::optional<GridOptions> hard = {}) {
  options.hard_grid = hard ? *hard : options.grid;
  if (!hard) options.hard_grid->thickness *= std::sqrt(options.hard.diffusivity / options.soft.diffusivity);
  return options;
}

inline ModelOptions graded(ModelOptions options, int cells = 60, double grading = 1.08) {
  options.grid.cells = cells;
  options.grid.grading = grading;
  return options;
}

// Returns the shortest step that the service accepts.
inline double shortest_step(const ModelOptions& options) {
  const double controlled = options.tolerance ? kShortestControlledStep : 0.0;
  return options.modes ? std::max(controlled, options.modes->shortest_step) : controlled;
}

// Returns the index of a lane's value in a tile of states, in `row` of the array that starts at `part`. Row 0 is the
// interface, z = 0; rows in the hard body are negative.
inline std::size_t place(std::size_t part, int row, int lane) {
  return part + static_cast<std::size_t>(std::ptrdiff_t{row} * kLanes + lane);
}

class Rig {
 public:
  explicit Rig(const ModelOptions& options, std::uint32_t active = 0xff)
      : model(options),
        committed(model.layout().doubles),
        trial(model.layout().doubles),
        heat_grid_(make_heat_grid(model)) {
    if (nodes_sleep(options)) basis_.emplace(heat_grid_, options.soft, options.hard);
    double temperature[kLanes];
    for (double& T : temperature) T = options.initial_temperature;
    start(temperature);
    inputs.active = active;
    for (int l = 0; l < kLanes; ++l) inputs.mass_soft[l] = inputs.mass_hard[l] = 1.0;
  }

  void start(const double (&temperature)[kLanes]) { model.initialise(committed.data(), temperature); }

  // Sets the temperature of a conducting hard body before the first step, so that the interface need not be the hottest
  // place.
  void start_hard(double temperature) {
    const TileLayout& layout = model.layout();
    std::fill_n(committed.data() + layout.first_temperature(), layout.num_hard_vertices * kLanes, temperature);
  }

  // Takes one accepted step of every active lane.
  void step(double dt) {
    if (!operators || operators->dt() != dt) operators = model.operators(dt);
    model.advance(*operators, inputs, committed.data(), trial.data(), outputs);
    std::swap(committed, trial);  // `trial` is now the state before the step
  }

  void set_all(double velocity_jump, double pressure) {
    for (int l = 0; l < kLanes; ++l) {
      inputs.velocity_jump[l] = velocity_jump;
      inputs.pressure[l] = pressure;
    }
  }

  // Returns the temperature at a vertex for a lane that does not sleep. Negative vertices belong to a conducting hard
  // body.
  double T(int vertex, int lane = 0) const { return committed[place(model.layout().temperature, vertex, lane)]; }
  double ep(int vertex, int lane = 0) const { return ep_of(committed, vertex, lane); }
  double ep_of(const std::vector<double>& tile, int vertex, int lane) const {
    return tile[place(model.layout().plastic_strain, vertex, lane)];
  }
  double heat_shape(int vertex, int lane = 0) const {
    return committed[place(model.layout().heat_shape, vertex, lane)];
  }
  double friction_state(int lane = 0) const { return committed[model.layout().friction_state + lane]; }
  double junction_strain(int lane = 0) const { return committed[model.layout().junction_strain + lane]; }
  double stress(int lane = 0) const { return committed[model.layout().shear_stress + lane]; }
  double second_stress(int lane = 0) const { return committed[model.layout().second_stress + lane]; }

  const HeatGrid& heat_grid() const { return heat_grid_; }

  // Returns the temperatures of a lane in a tile of states, one for each row of heat_grid(). The temperatures of a
  // sleeping lane are computed from its modes. A model without a temperature profile has one temperature only, the
  // interface temperature T0.
  std::vector<double> temperatures(const std::vector<double>& tile, int lane) const {
    const TileLayout& layout = model.layout();
    const std::size_t rows = layout.num_hard_vertices + layout.num_vertices;
    const double* first = tile.data() + layout.temperature - layout.num_hard_vertices * kLanes;
    std::vector<double> profile(rows * kLanes);
    if (asleep(layout, tile.data(), lane)) {
      to_profile(*basis_, static_cast<int>(tile[layout.resting + kLanes + static_cast<std::size_t>(lane)]), lane, first,
                 profile.data());
      first = profile.data();
    }
    for (std::size_t i = 0; i < rows; ++i) profile[i] = first[i * kLanes + static_cast<std::size_t>(lane)];
    profile.resize(rows);
    return profile;
  }
  // Returns the temperatures of the layer and of the body behind it, from z = 0 on.
  std::vector<double> layer_temperatures(int lane) const {
    std::vector<double> all = temperatures(committed, lane);
    all.erase(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(model.layout().num_hard_vertices));
    return all;
  }
  // Returns true if the lane sleeps before or after the last step.
  bool slept(int lane) const {
    return asleep(model.layout(), committed.data(), lane) || asleep(model.layout(), trial.data(), lane);
  }

  // Returns the heat [J/m2] stored in all conducting bodies above the temperature `reference`: (k/alpha) integral(T -
  // reference) with conductivity k and diffusivity alpha. The integral has the weights of the conduction scheme.
  double stored_heat(double reference, int lane = 0) const { return stored_heat_of(committed, reference, lane); }
  double stored_heat_of(const std::vector<double>& tile, double reference, int lane) const {
    if (const TileLayout& layout = model.layout(); layout.heat_modes != TileLayout::kAbsent) {
      // Without a temperature profile the stored heat is known only for an insulated slab: its mode with decay rate 0
      // is the mean temperature.
      const double* rows = tile.data() + layout.heat_modes + lane;
      const ModelOptions& o = model.options();
      return o.soft.conductivity / o.soft.diffusivity * o.grid.thickness * (rows[0] + rows[kLanes] - reference);
    }
    const std::vector<double> T = temperatures(tile, lane);
    double sum = 0.0;
    for (std::size_t i = 0; i < T.size(); ++i) {
      sum += heat_grid_.capacity(static_cast<int>(i), model.options().soft, model.options().hard) * (T[i] - reference);
    }
    // What c(T) adds to the heat: of a slope c a/2 (T - 300 K)^2 of each body.
    for (std::size_t i = 0; conducts_by_temperature(model.options()) && i < T.size(); ++i) {
      const HeatTables& tables = heat_tables(model.options());
      const auto more = [&](const Material& m, double weight) {
        const HeatTable& table = &m == &model.options().soft ? tables.soft_heat : tables.hard_heat;
        if (!table.empty())
          return m.conductivity / m.diffusivity * weight * (table.mean(reference, T[i]) - 1.0) * (T[i] - reference);
        const auto of = [](double x) { return (x - 300.0) * (x - 300.0); };
        const double slope = std::isfinite(m.specific_heat_slope) ? m.specific_heat_slope : 0.0;
        return m.conductivity / m.diffusivity * weight * 0.5 * slope * (of(T[i]) - of(reference));
      };
      const auto interface = static_cast<std::size_t>(heat_grid_.interface);
      if (i >= interface) sum += more(model.options().soft, heat_grid_.weight[i]);
      if (i <= interface)
        sum += more(model.options().hard, i < interface ? heat_grid_.weight[i] : heat_grid_.hard_weight);
    }
    if (!model.options().melt_film) return sum;
    return sum + model.options().soft.density * model.options().melt_film->latent_heat * film_thickness_of(tile, lane);
  }

  // Returns the fraction of the metal at a vertex of the soft body that is liquid, for a model with a melt film.
  double liquid(int vertex, int lane = 0) const {
    return committed[place(model.layout().liquid_fraction, vertex, lane)];
  }
  // Returns the thickness of the melt  [m].
  double film_thickness(int lane = 0) const { return film_thickness_of(committed, lane); }
  double film_thickness_of(const std::vector<double>& tile, int lane) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < model.layout().num_vertices; ++i)
      sum += heat_grid_.weight[heat_grid_.interface + i] *
             tile[place(model.layout().liquid_fraction, static_cast<int>(i), lane)];
    return sum;
  }

  // Returns the share of the friction power that enters the bodies whose conduction is computed: the soft body's share,
  // the heat partition beta_T, or 1 if both bodies conduct.
  double conducted_share() const {
    const ModelOptions& o = model.options();
    return o.hard_grid ? 1.0 : heat_partition(o.soft, o.hard);
  }

  // Returns the plastic slip that the layer has carried since the start, sqrt(3) integral(ep) with the plastic strain
  // ep  [m].
  double plastic_slip(int lane = 0) const { return plastic_slip_of(committed, lane); }
  double plastic_slip_of(const std::vector<double>& tile, int lane) const {
    double sum = 0.0;
    for (int i = 0; i < model.grid().num_vertices(); ++i) {
      sum += model.grid().weight[i] * ep_of(tile, i, lane);
    }
    return kSqrt3 * sum;
  }

  reference::NodeState node_state(int lane) const {
    reference::NodeState state;
    for (std::size_t i = model.layout().num_hard_vertices; i > 0; --i)
      state.hard_temperature.push_back(T(-static_cast<int>(i), lane));
    for (std::size_t i = 0; i < model.layout().num_heat_modes; ++i)
      state.hard_temperature.push_back(
          committed[model.layout().heat_modes + i * kLanes + static_cast<std::size_t>(lane)]);
    for (std::size_t i = 0; i < model.layout().num_vertices; ++i)
      state.temperature.push_back(T(static_cast<int>(i), lane));
    for (int i = 0; i < model.grid().num_vertices(); ++i) {
      state.plastic_strain.push_back(model.layout().plastic_strain == TileLayout::kAbsent ? 0.0 : ep(i, lane));
    }
    if (model.layout().sticking != TileLayout::kAbsent) {
      state.sticking = committed[model.layout().sticking + lane] != 0.0;
    }
    if (model.layout().junction_strain != TileLayout::kAbsent) state.junction_strain = junction_strain(lane);
    if (model.layout().num_friction_states > 0) state.friction_state = friction_state(lane);
    if (model.layout().heat_shape != TileLayout::kAbsent) {
      for (int i = 0; i < model.grid().num_vertices(); ++i) state.heat_shape.push_back(heat_shape(i, lane));
    }
    const TileLayout& layout = model.layout();
    for (std::size_t i = 0; i < layout.num_vertices && layout.liquid_fraction != TileLayout::kAbsent; ++i)
      state.liquid_fraction.push_back(liquid(static_cast<int>(i), lane));
    for (std::size_t i = 0; i < layout.num_velocity_cells; ++i)
      state.layer_velocity.push_back(committed[layout.layer_velocity + i * kLanes + lane]);
    for (std::size_t i = 0; i < layout.num_stress_vertices && layout.num_velocity_cells > 0; ++i)
      state.stress_field.push_back(committed[layout.shear_stress + i * kLanes + lane]);
    state.shear_stress = stress(lane);
    state.regime = static_cast<Regime>(static_cast<int>(committed[model.layout().regime + lane]));
    return state;
  }

  reference::NodeInputs node_inputs(int lane) const {
    return {inputs.velocity_jump[lane],   inputs.pressure[lane],
            inputs.soft_shear_rate[lane], inputs.stress_soft[lane],
            inputs.stress_hard[lane],     inputs.mass_soft[lane],
            inputs.mass_hard[lane],       inputs.soft_plastic_strain_rate[lane]};
  }

  Model model;
  std::shared_ptr<const StepOperators> operators;
  TileInputs inputs;
  TileOutputs outputs{};
  std::vector<double> committed, trial;

 private:
  static HeatGrid make_heat_grid(const Model& model) {
    const ModelOptions& o = model.options();
    if (!o.hard_grid) return HeatGrid(model.grid(), o.grid.far_boundary);
    return HeatGrid(model.grid(), o.grid.far_boundary, Grid(*o.hard_grid), o.hard_grid->far_boundary);
  }

  HeatGrid heat_grid_;
  std::optional<HeatBasis> basis_;  // modes of the grid, set only if the model has the option `sleep`
};

}  // namespace shearbus::testing
