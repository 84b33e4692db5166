#include "server/physics/material/heat_table.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace shearbus::physics {

namespace {

// The row after a temperature, for one of several rows: 0 below the first, their number from the last on.
std::size_t row_after(const std::vector<double>& temperature, double T) {
  std::size_t row = 0;
  while (row < temperature.size() && temperature[row] <= T) ++row;
  return row;
}

}  // namespace

double HeatTable::at(double T) const {
  const std::size_t row = row_after(temperature, T);
  if (row == 0 || row == temperature.size()) return row == 0 ? share.front() : share.back();
  const double part = (T - temperature[row - 1]) / (temperature[row] - temperature[row - 1]);
  return share[row - 1] + part * (share[row] - share[row - 1]);
}

double HeatTable::mean(double T_1, double T_2) const {
  const auto [from, to] = std::minmax(T_1, T_2);
  if (row_after(temperature, from) == row_after(temperature, to)) return at(0.5 * (from + to));  // linear between them
  double T = from, value = at(from);
  double sum = 0.0;
  for (std::size_t i = 0; i < temperature.size() && to > from; ++i) {
    if (!(temperature[i] > from && temperature[i] < to)) continue;
    sum += 0.5 * (temperature[i] - T) * (value + share[i]);
    T = temperature[i];
    value = share[i];
  }
  return to > from ? (sum + 0.5 * (to - T) * (value + at(to))) / (to - from) : value;
}

}  // namespace shearbus::physics
