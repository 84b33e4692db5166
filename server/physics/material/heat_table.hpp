// k(T) or c(T) of a body as a table: linear between its rows, constant outside of them.
#pragma once

#include <cstddef>
#include <vector>

namespace shearbus::physics {

// Rows of rising temperature. An empty table is none.
struct HeatTable {
  std::vector<double> temperature;  // [K]
  std::vector<double> share;        // k or c there, over the body's constant k or c  [1]

  bool empty() const { return temperature.empty(); }
  double at(double T) const;
  // The mean between two temperatures: the difference of Kirchhoff's transform, or of the enthalpy, over that of T.
  double mean(double T_1, double T_2) const;
};

struct HeatTables {
  HeatTable soft_conductivity, soft_heat, hard_conductivity, hard_heat;
};

inline constexpr std::size_t kMostTableRows = 100;

}  // namespace shearbus::physics
