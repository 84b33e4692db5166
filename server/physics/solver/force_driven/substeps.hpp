// A force-driven step of one lane in equal substeps, taken where the whole step may have several answers
// (server/physics/MODEL.md section 6).
#pragma once

#include <cmath>
#include <cstddef>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

struct LaneResult {
  LaneStep step;
  double heat;  // entered the layer  [J/m2]
};

inline void set_outputs(const LaneResult& result, int lane, TileOutputs& outputs) {
  outputs.shear_stress[lane] = result.step.stress;
  outputs.sliding_velocity[lane] = result.step.slip;
  outputs.velocity_jump_new[lane] = result.step.jump_new;
  outputs.friction_heat[lane] = result.heat;
  outputs.regime[lane] = result.step.regime;
}

// `before` is the lane's step so far: its stress, jump_new and sticks are where the first substep starts from.
// `substep(from)` gives the LaneStep after conduction, from the last one. Stops at the first one that is not unique
// unless `accept` says to go on. `temperature` is [vertex][lane], old values in, new ones out.
template <class Heat, class Substep>
bool run_substeps(const Heat& heat, int num_vertices, int substeps, bool accept, int lane, const LaneStep& before,
                  double* temperature, LaneResult& result, const Substep& substep) {
  LaneStep last = before;
  result = {{0.0, 0.0, before.jump_new, 0.0, before.regime, before.sticks, true, false}, 0.0};
  for (int j = 0; j < substeps; ++j) {
    conduct_lane(heat, num_vertices, lane, temperature);
    last = substep(last);
    if (!last.unique && !accept) return false;
    add_flux_lane(heat, num_vertices, lane, last.flux, temperature);
    result.step.stress += last.stress / substeps;
    result.step.slip += last.slip / substeps;
    result.step.jump_new = last.jump_new;
    result.step.regime = last.regime;
    result.step.sticks = last.sticks;
    result.step.several |= last.several;
    result.heat += last.flux * heat.dt;
  }
  // Means over a step in which the slip reverses could oppose each other; friction does no negative work.
  if (result.step.stress * result.step.slip < 0.0) result.step.slip = 0.0;
  return true;
}

// Such a step in 2, 4, ... substeps until each has one answer, or `max_halvings` (at least 1: the finest substep of a
// step whose error is controlled is taken as it is) are made; `heat_of(k)` is the operator of dt / 2^k. `restart()`
// takes back what substeps have changed beside the temperature, `substep(heat, from)` is one.
template <class HeatOf, class Restart, class Substep>
void divide_step(const HeatOf& heat_of, int max_halvings, int num_vertices, int lane, const LaneStep& before,
                 const double* T_old, double* temperature, LaneResult& result, const Restart& restart,
                 const Substep& substep) {
  for (int k = 1; k <= max_halvings; ++k) {
    const auto& heat = heat_of(k);
    copy_lane(T_old, temperature, static_cast<std::size_t>(num_vertices) * kLanes, lane);
    restart();
    if (run_substeps(heat, num_vertices, 1 << k, k == max_halvings, lane, before, temperature, result,
                     [&](const LaneStep& last) { return substep(heat, last); })) {
      return;
    }
  }
}

}  // namespace shearbus::physics
