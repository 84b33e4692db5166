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

// Of one body: the mean of k or c between two temperatures, over its constant k or c.
struct Shares {
  const Material& body;
  const HeatTable &conductivity, &heat;

  double conducts(double T_1, double T_2) const {
    if (!conductivity.empty()) return conductivity.mean(T_1, T_2);
    return body.conductivity_share(0.5 * (T_1 + T_2));
  }
  double holds(double T_1, double T_2) const {
    if (!heat.empty()) return heat.mean(T_1, T_2);
    return body.heat_share(0.5 * (T_1 + T_2));
  }
};

}  // namespace

HeatGrid grid_between(const Problem& problem, const double* T_old, const double* T_new) {
  const HeatTables& tables = heat_tables(problem.options);
  const Shares soft{problem.options.soft, tables.soft_conductivity, tables.soft_heat};
  const Shares hard{problem.options.hard, tables.hard_conductivity, tables.hard_heat};
  HeatGrid grid = problem.heat_grid;
  const auto interface = static_cast<std::size_t>(grid.interface);
  const auto between = [&](std::size_t i) { return 0.5 * (T_old[i * kLanes] + T_new[i * kLanes]); };
  for (std::size_t i = 0; i < grid.width.size(); ++i)
    grid.width[i] /= (i < interface ? hard : soft).conducts(between(i), between(i + 1));
  for (std::size_t i = 0; i < grid.weight.size(); ++i)
    grid.weight[i] *= (i < interface ? hard : soft).holds(T_old[i * kLanes], T_new[i * kLanes]);
  grid.hard_weight *= hard.holds(T_old[interface * kLanes], T_new[interface * kLanes]);
  return grid;
}

void advance_varying(const Problem& problem, double dt, AdvanceTile solve, const TileInputs& inputs,
                     const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const std::size_t first = layout.first_temperature();
  const auto rows = static_cast<std::size_t>(problem.heat_rows);
  double* found = scratch_tile(Scratch::kVarying, layout.doubles);
  std::vector<double> end(rows * kLanes), last(rows);
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
        end[i * kLanes] = T[i * kLanes];
        if (pass > 0) moved = std::max(moved, std::abs(T[i * kLanes] - last[i]));
        last[i] = T[i * kLanes];
      }
      if (pass > 1 && !(moved > kMet)) break;
      own.heat_grid = grid_between(problem, T_old, end.data());
      const auto operators = make_operators(own, dt, 0);
      solve(own, *operators, one, committed, found, outputs);
      T = found + first + lane;
    }
    copy_lane(found, trial, layout.doubles, l);
  }
}

}  // namespace shearbus::physics
