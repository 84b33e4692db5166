#include "server/physics/material/heat_table.hpp"

#include <algorithm>

namespace shearbus::physics {

double HeatTable::at(double T) const {
  if (!(T > temperature.front())) return share.front();
  if (T >= temperature.back()) return share.back();
  const auto next =
      static_cast<std::size_t>(std::upper_bound(temperature.begin(), temperature.end(), T) - temperature.begin());
  const double part = (T - temperature[next - 1]) / (temperature[next] - temperature[next - 1]);
  return share[next - 1] + part * (share[next] - share[next - 1]);
}

double HeatTable::mean(double T_1, double T_2) const {
  const auto [from, to] = std::minmax(T_1, T_2);
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
