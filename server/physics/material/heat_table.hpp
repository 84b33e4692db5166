// k(T) or c(T) of a body as a table: linear between its rows, constant outside of them.
#pragma once

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

// Each of them, with the keys of its columns in a scene.
struct HeatTableKeys {
  HeatTable HeatTables::*table;
  const char *temperatures, *values;
};
inline constexpr HeatTableKeys kHeatTables[] = {
    {&HeatTables::soft_conductivity, "soft.thermal_conductivity_table_temperature_k",
     "soft.thermal_conductivity_table_w_per_m_k"},
    {&HeatTables::soft_heat, "soft.specific_heat_table_temperature_k", "soft.specific_heat_table_j_per_kg_k"},
    {&HeatTables::hard_conductivity, "hard.thermal_conductivity_table_temperature_k",
     "hard.thermal_conductivity_table_w_per_m_k"},
    {&HeatTables::hard_heat, "hard.specific_heat_table_temperature_k", "hard.specific_heat_table_j_per_kg_k"},
};

}  // namespace shearbus::physics
