#include "hydro_stub/pressure_history.hpp"

#include <algorithm>
#include <utility>

namespace shearbus::hydro {

PressureHistory::PressureHistory(std::vector<double> times, std::vector<double> values)
    : times_(std::move(times)), values_(std::move(values)) {}

double PressureHistory::at(double time, std::size_t column) const {
  if (times_.empty()) return values_[column];
  if (time <= times_.front()) return values_.front();
  if (time >= times_.back()) return values_.back();
  const std::size_t next = static_cast<std::size_t>(std::ranges::upper_bound(times_, time) - times_.begin());
  const double part = (time - times_[next - 1]) / (times_[next] - times_[next - 1]);
  return values_[next - 1] + part * (values_[next] - values_[next - 1]);
}

}  // namespace shearbus::hydro
