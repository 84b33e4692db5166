// The force-driven step of one lane, divided into 2, 4, ... equal substeps where the whole step may have several
// answers (MODEL.md, "Force-driven step"). Both force-driven solvers divide steps in this way; each supplies its own
// function for a substep.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// One lane at the start of a step.
struct LaneStart {
  int lane;
  const LaneStep& before;  // state before the step; of it only stress, jump_new, regime and sticks are used
  int num_rows;            // number of rows of temperatures or modes, [row][lane]
  const double* T_old;     // temperatures or modes before the step
  double* T;               // temperatures or modes after conduction over the whole step, or after the substeps
};

// Makes equal substeps from the old temperatures. `substep(from)` makes the substep that follows the LaneStep `from`,
// after its conduction. Returns false at the first substep without a unique answer, unless `accept` is true.
template <class Heat, class Substep>
bool run_substeps(const Heat& heat, int substeps, bool accept, const LaneStart& start, LaneResult& result,
                  const Substep& substep) {
  const LaneStep& before = start.before;
  LaneStep last = before;
  result = {{0.0, 0.0, before.jump_new, 0.0, before.regime, before.sticks, true, false}, 0.0, 0.0, kSubstepped};
  for (int j = 0; j < substeps; ++j) {
    conduct_lane(heat, start.num_rows, start.lane, start.T);
    last = substep(last);
    if (!last.unique && !accept) return false;
    add_flux_lane(heat, start.num_rows, start.lane, last.flux, start.T);
    result.step.stress += last.stress / substeps;
    result.step.slip += last.slip / substeps;
    result.step.jump_new = last.jump_new;
    result.step.regime = last.regime;
    result.step.sticks = last.sticks;
    result.step.several |= last.several;
    result.heat += last.flux * heat.dt;
  }
  // If the slip reverses within the step, the means of stress and slip may have opposite signs. The mean slip is then
  // set to 0, because the work of friction cannot be negative.
  if (result.step.stress * result.step.slip < 0.0) result.step.slip = 0.0;
  return true;
}

// The answer of a lane whose whole step gave `whole`. If that answer is unique it is accepted; otherwise the step is
// divided into 2, 4, ..., 2^max_halvings substeps until each has a unique answer, and the finest substeps are accepted
// in any case. With max_halvings = 0 (a step whose error is controlled is short enough already) the whole step is
// accepted.
//   heat_of(k)           heat operator of a step of length dt / 2^k
//   restart()            restores the quantities other than temperatures that substeps change
//   substep(heat, from)  one substep after conduction
template <class HeatOf, class Restart, class Substep>
LaneResult step_or_divide(const LaneStep& whole, const HeatOf& heat_of, int max_halvings, const LaneStart& start,
                          const Restart& restart, const Substep& substep) {
  LaneResult result{whole, whole.flux * heat_of(0).dt, whole.flux, whole.unique ? std::uint8_t{0} : kSubstepped};
  for (int k = 1; !whole.unique && k <= max_halvings; ++k) {
    const auto& heat = heat_of(k);
    copy_lane(start.T_old, start.T, static_cast<std::size_t>(start.num_rows) * kLanes, start.lane);
    restart();
    if (run_substeps(heat, 1 << k, k == max_halvings, start, result,
                     [&](const LaneStep& last) { return substep(heat, last); }))
      break;
  }
  if (result.step.several) result.outcome |= kMultipleRoots;
  return result;
}

}  // namespace shearbus::physics
