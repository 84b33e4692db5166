#pragma once

#include <cstddef>
#include <vector>

namespace shearbus::hydro {

// Pressure on the interface: either one constant value per column, or one table over time that holds for all columns.
struct PressureHistory {
  std::vector<double> times;   // times of the table  [s]; empty if `values` holds one value per column
  std::vector<double> values;  // pressures at `times`; without a table, one pressure per column  [Pa]

  // Returns the pressure at `time` in `column`, linear between the times of the table and constant outside  [Pa].
  double at(double time, std::size_t column) const;
};

}  // namespace shearbus::hydro
