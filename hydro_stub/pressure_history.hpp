#pragma once

#include <cstddef>
#include <vector>

namespace shearbus::hydro {

// Pressure on the interface: either one constant value per column, or one table over time that holds for all columns.
class PressureHistory {
 public:
  PressureHistory() = default;
  PressureHistory(std::vector<double> times, std::vector<double> values);

  // Returns the pressure at `time` in `column`, linear between the times of the table and constant outside  [Pa].
  double at(double time, std::size_t column) const;

 private:
  std::vector<double> times_;   // times of the table  [s]; empty if values_ holds one value per column
  std::vector<double> values_;  // pressures at times_; without a table, one pressure per column  [Pa]
};

}  // namespace shearbus::hydro
