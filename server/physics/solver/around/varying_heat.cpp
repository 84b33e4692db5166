#include "server/physics/solver/around/varying_heat.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {
namespace {

// A step is repeated with coefficients of the temperatures it has found until they change by no more, but so often at
// most: a change of k or c by a part x makes each repetition about x closer.
constexpr double kMet = 1e-6;  // [K]
constexpr int kMostCorrections = 8;

}  // namespace

HeatGrid grid_at(const Problem& problem, const double* T) {
  const Material &soft = problem.options.soft, &hard = problem.options.hard;
  HeatGrid grid = problem.heat_grid;
  const auto interface = static_cast<std::size_t>(grid.interface);
  const auto at = [&](std::size_t i) { return T[i * kLanes]; };
  for (std::size_t i = 0; i < grid.width.size(); ++i)
    grid.width[i] /= (i < interface ? hard : soft).conductivity_share(0.5 * (at(i) + at(i + 1)));
  for (std::size_t i = 0; i < grid.weight.size(); ++i)
    grid.weight[i] *= (i < interface ? hard : soft).heat_share(at(i));
  grid.hard_weight *= hard.heat_share(at(interface));
  return grid;
}

void advance_varying(const Problem& problem, double dt, AdvanceTile solve, const TileInputs& inputs,
                     const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const std::size_t first = layout.first_temperature();
  const auto rows = static_cast<std::size_t>(problem.heat_rows);
  double* found = scratch_tile(Scratch::kVarying, layout.doubles);
  std::vector<double> between(rows * kLanes), last(rows);
  Problem own = problem;
  for (const int l : lanes_of(inputs.active)) {
    const auto lane = static_cast<std::size_t>(l);
    TileInputs one = inputs;
    one.active = 1U << l;
    const double* T_old = committed + first + lane;
    const double* T = T_old;
    for (int pass = 0; pass <= kMostCorrections; ++pass) {
      double moved = 0.0;
      for (std::size_t i = 0; i < rows; ++i) {
        between[i * kLanes + lane] = 0.5 * (T_old[i * kLanes] + T[i * kLanes]);
        if (pass > 0) moved = std::max(moved, std::abs(T[i * kLanes] - last[i]));
        last[i] = T[i * kLanes];
      }
      if (pass > 1 && !(moved > kMet)) break;
      own.heat_grid = grid_at(problem, between.data() + lane);
      const auto operators = make_operators(own, dt, 0);
      solve(own, *operators, one, committed, found, outputs);
      T = found + first + lane;
    }
    copy_lane(found, trial, layout.doubles, l);
  }
}

}  // namespace shearbus::physics
