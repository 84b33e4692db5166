#include "server/physics/solver/sdirk2.hpp"

#include <algorithm>
#include <vector>

namespace shearbus::physics::sdirk2 {
namespace {

constexpr double kRounding = 1e-12;  // relative distance below the coldest old temperature that counts as rounding

}  // namespace

void begin_second_stage(const HeatOperator& stage, int num_rows, const double* T_old,
                        const double (&/*early_flux*/)[kLanes], double* T) {
  extrapolate_rows(num_rows, kExtrapolation, T_old, T);
  conduct(stage, num_rows, T, T);
}
void begin_second_stage(const ModeOperator& step, int num_rows, const double* old, const double (&early_flux)[kLanes],
                        double* rows) {
  conduct(step, num_rows, old, rows);
  add_early_flux(step, num_rows, early_flux, rows);
}

void respond_to_constant_flux(HeatOperator& heat, double dt) {
  const std::size_t n = heat.response.size();
  std::vector<double> rows(n * kLanes, 0.0);
  for (std::size_t i = 0; i < n; ++i) rows[i * kLanes] = kExtrapolation * heat.response[i];
  conduct_lane(heat, static_cast<int>(n), 0, rows.data());
  for (std::size_t i = 0; i < n; ++i) heat.response[i] += rows[i * kLanes];
  heat.dt = dt;
}

std::uint32_t lanes_out_of_range(const Problem& problem, const TileInputs& inputs, const double* T_old, double* T) {
  const std::ptrdiff_t rows = problem.heat_rows;
  // A model with modes has only one temperature to check, T0 in its last row. T0 cannot fall below the initial
  // temperature, because each mode contributes a positive share to T0.
  const std::ptrdiff_t first = problem.modes ? rows - 1 : 0;
  double coldest[kLanes] = {}, lowest[kLanes], highest[kLanes];
  range_of_rows(rows - first, T + first * kLanes, lowest, highest);
  if (!problem.modes) {
    double hottest[kLanes];
    range_of_rows(rows, T_old, coldest, hottest);
  }
  const LaneMaterials soft(problem.options.soft, inputs);
  std::uint32_t out = 0;
  for (const int l : lanes_of(inputs.active)) {
    if (!(highest[l] < soft(l).melting_temperature) || !(lowest[l] >= coldest[l] * (1.0 - kRounding))) {
      out |= 1u << l;
    } else if (lowest[l] < coldest[l]) {
      for (std::ptrdiff_t i = first; i < rows; ++i) T[i * kLanes + l] = std::max(T[i * kLanes + l], coldest[l]);
    }
  }
  return out;
}

}  // namespace shearbus::physics::sdirk2
