#include "hydro_stub/pressure_history.hpp"

#include <algorithm>

namespace shearbus::hydro {

double PressureHistory::at(double time, std::size_t column) const {
  if (times.empty()) return values[column];
  if (time <= times.front()) return values.front();
  if (time >= times.back()) return values.back();
  const std::size_t next = static_cast<std::size_t>(std::ranges::upper_bound(times, time) - times.begin());
  const double part = (time - times[next - 1]) / (times[next] - times[next - 1]);
  return values[next - 1] + part * (values[next] - values[next - 1]);
}

}  // namespace shearbus::hydro
