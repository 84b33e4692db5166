// Counts of steps, and largest residuals, of a run whose steps are checked against the invariants of the model.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

// Counts and largest residuals over all node-steps of a run; a node-step is one step of one node.
struct Figures {
  long node_steps = 0;
  std::array<long, 5> in_regime{};  // number of node-steps that ended in each Regime
  long divided = 0;                 // number of node-steps that were divided into substeps
  long several = 0;                 // number of node-steps whose equations have several solutions
  long flowing = 0;                 // number of node-steps in which a plastic layer carries a stress
  long flowing_resolved = 0;        // number of node-steps of `flowing` in which rounding errors do not hide the slip
  long films = 0;                   // number of node-steps that ended with liquid in a closed contact
  double heat_residual = 0.0;       // largest residual of the heat balance, relative to the stored heat
  double nearest_melting = std::numeric_limits<double>::infinity();  // smallest |T_melt - T| of a vertex [K]
  double over_limit = 0.0;  // largest excess of a stress over its limit, relative to the limit

  void add(const Figures& other) {
    node_steps += other.node_steps;
    for (std::size_t i = 0; i < in_regime.size(); ++i) in_regime[i] += other.in_regime[i];
    divided += other.divided;
    several += other.several;
    flowing += other.flowing;
    flowing_resolved += other.flowing_resolved;
    films += other.films;
    heat_residual = std::max(heat_residual, other.heat_residual);
    nearest_melting = std::min(nearest_melting, other.nearest_melting);
    over_limit = std::max(over_limit, other.over_limit);
  }
  long regime(Regime which) const { return in_regime[static_cast<std::size_t>(which)]; }
};

}  // namespace shearbus::testing
