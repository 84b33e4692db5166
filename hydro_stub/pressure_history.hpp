#pragma once

#include <cstddef>
#include <vector>

namespace shearbus::hydro {

// Pressure on the interface: constant in each column, or a table in time for all of them.
class PressureHistory {
 public:
  PressureHistory() = default;
  PressureHistory(std::vector<double> times, std::vector<double> values);

  bool varies() const { return !times_.empty(); }
  // At `time` in `column`: linear between the times of the table, constant outside.
  double at(double time, std::size_t column) const;

 private:
  std::vector<double> times_;   // empty: values_ is per column
  std::vector<double> values_;  // [Pa]
};

}  // namespace shearbus::hydro
