// Random states and histories for tests; every step of a history is checked against the invariants.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/invariants.hpp"
#include "tests/support/random_physics.hpp"
#include "tests/support/sleepers.hpp"

namespace shearbus::testing {

// Draws a state of a node that need not be reachable by any history: temperatures that fall with the distance from the
// interface, any plastic strain, and a stress left from a higher pressure.
inline void random_state(Draw& draw, Rig& rig) {
  const TileLayout& layout = rig.model.layout();
  const ModelOptions& options = rig.model.options();
  const Grid& grid = rig.model.grid();
  const HeatGrid& heat = rig.heat_grid();
  const double T_melt = options.soft.melting_temperature;
  // modes cannot be drawn, because they depend on a whole history
  if (layout.heat_modes != TileLayout::kAbsent) return;
  for (int l = 0; l < kLanes; ++l) {
    const auto set = [&](std::size_t part, int row, double value) {
      rig.committed[part + static_cast<std::size_t>(row * kLanes + l)] = value;
    };
    const double far = draw.uniform(1.0, std::max(T_melt - 20.0, 0.5 * T_melt));
    const double hottest =
        draw.chance(0.3) ? std::max(far, T_melt - draw.log_uniform(1e-9, 100.0)) : draw.uniform(far, T_melt);
    const double depth = options.grid.thickness * draw.log_uniform(1e-3, 10.0);
    double z = 0.0;
    set(layout.first_temperature(), heat.interface, hottest);
    for (int i = heat.interface + 1; i < heat.num_vertices(); ++i) {
      z += heat.width[static_cast<std::size_t>(i - 1)];
      set(layout.first_temperature(), i, far + (hottest - far) * std::exp(-z / depth));
    }
    z = 0.0;
    for (int i = heat.interface - 1; i >= 0; --i) {
      z += heat.width[static_cast<std::size_t>(i)];
      set(layout.first_temperature(), i, far + (hottest - far) * std::exp(-z / depth));
    }
    const double stress = draw.chance(0.2) ? 0.0 : draw.sign() * draw.log_uniform(1.0, 1e10);
    const bool wavy = options.inertia;
    for (std::size_t i = 0; i < layout.num_stress_vertices; ++i) {
      set(layout.shear_stress, static_cast<int>(i), wavy ? draw.uniform(-1.0, 1.0) * stress : stress);
    }
    for (std::size_t i = 0; i < layout.num_velocity_cells; ++i) {
      set(layout.layer_velocity, static_cast<int>(i), draw.uniform(-1.0, 1.0) * 1e3);
    }
    if (layout.second_stress != TileLayout::kAbsent) set(layout.second_stress, 0, draw.uniform(-1.0, 1.0) * stress);
    const double strain = draw.log_uniform(1e-6, 1e3);
    for (std::size_t i = 0; i < layout.num_strain_vertices; ++i) {
      set(layout.plastic_strain, static_cast<int>(i), draw.chance(0.2) ? 0.0 : draw.uniform(0.0, 1.0) * strain);
    }
    if (layout.heat_shape != TileLayout::kAbsent) {
      for (int i = 0; i < grid.num_vertices(); ++i) set(layout.heat_shape, i, 0.0);
      set(layout.heat_shape, draw.integer(0, grid.num_vertices() - 1), *options.taylor_quinney_factor);
    }
    if (layout.liquid_fraction != TileLayout::kAbsent && draw.chance(0.6)) {
      // A film from z = 0 on, or behind vertices that have frozen, whose outermost vertex melts.
      const int last = draw.integer(0, std::max(0, static_cast<int>(layout.num_vertices) - 2));
      for (int i = draw.chance(0.7) ? 0 : draw.integer(0, last); i <= last; ++i) {
        set(layout.liquid_fraction, i, i < last ? 1.0 : draw.uniform(0.0, 1.0));
        set(layout.temperature, i, i < last ? T_melt + draw.uniform(0.0, 300.0) : T_melt);
      }
    }
    set(layout.regime, 0, draw.integer(0, 4));
    if (layout.sticking != TileLayout::kAbsent) set(layout.sticking, 0, draw.chance(0.5) ? 1.0 : 0.0);
    if (layout.junction_strain != TileLayout::kAbsent) set(layout.junction_strain, 0, draw.log_uniform(1e-6, 1e3));
  }
}

// Draws the inputs of a step. Nodes that may sleep rest in phases, so that they do.
inline void random_step(Draw& draw, Rig& rig, bool extreme, int step, Phase& phase) {
  if (rig.model.options().sleep) {
    if (step % kStepsPerPhase == 0) phase = begin_phase(draw, rig, extreme);
    within_phase(phase, rig);
  } else if (rig.model.options().tangential_components == 2) {
    random_vectors(draw, rig, extreme);
  } else {
    random_inputs(draw, rig, extreme);
  }
}

// Runs a history of random inputs. `after_step(dt)` is called after each step, before the invariants are checked.
template <class AfterStep>
void random_history(Draw& draw, Rig& rig, bool extreme, int steps, Figures& figures, const AfterStep& after_step) {
  const ModelOptions& options = rig.model.options();
  const bool closed_loop = draw.chance(0.5) && options.strategy == Strategy::kForceDriven && !options.sleep;
  Phase phase{};
  for (int step = 0; step < steps; ++step) {
    random_step(draw, rig, extreme, step, phase);
    if (closed_loop && step > 0) {
      std::copy_n(rig.outputs.velocity_jump_new, kLanes, rig.inputs.velocity_jump);
      std::copy_n(rig.outputs.second_velocity_jump_new, kLanes, rig.inputs.second_velocity_jump);
    }
    const double dt = std::max(random_dt(draw, extreme), shortest_step(options));
    rig.step(dt);
    after_step(dt);
    for (int l = 0; l < kLanes; ++l) {
      try {
        require_invariants(rig, l, dt, figures);
      } catch (const Broken& broken) {
        throw Broken(fmt::format("step {}, lane {}, dt {:.3g} s: {}", step, l, dt, broken.what()));
      }
    }
  }
}

}  // namespace shearbus::testing
