#include "client/study/map/limits.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::map {

std::vector<double> slip_share(const Map& map, const Observation& seen) {
  std::vector<double> shares(map.axes.num_nodes());
  for (std::size_t p = 0; p < map.axes.pressure_pa.size(); ++p) {
    for (std::size_t v = 0; v < map.axes.velocity_m_per_s.size(); ++v) {
      const std::size_t i = map.axes.node(p, v);
      shares[i] = seen.slip_m[i] / (map.axes.velocity_m_per_s[v] * seen.time_s);
    }
  }
  return shares;
}

// Returns, for each pressure, the velocity from which on plastic slip exceeds this share of the imposed slip. The share
// is 1 - V_y / V, with the imposed velocity V and the part V_y = h s / (G0 t) that the layer carries elastically. V_y
// changes little between neighbouring nodes of the map, so V_y is interpolated instead of the share.
Line velocity_of_share(const Map& map, const Observation& seen, double share) {
  const std::vector<double> shares = slip_share(map, seen);
  const std::vector<double>& velocities = map.axes.velocity_m_per_s;
  Line line(map.axes.pressure_pa.size());
  for (std::size_t p = 0; p < line.size(); ++p) {
    for (std::size_t v = 0; v < velocities.size(); ++v) {
      const double carried = shares[map.axes.node(p, v)];
      if (!(carried > share)) continue;
      if (v == 0) break;
      const double before = shares[map.axes.node(p, v - 1)];
      if (before > 0.0) {
        const double part = std::log((1.0 - before) / (1.0 - share)) / std::log((1.0 - before) / (1.0 - carried));
        line[p] = velocities[v - 1] * std::pow(velocities[v] / velocities[v - 1], part);
      } else {
        line[p] = velocities[v] * (1.0 - carried) / (1.0 - share);
      }
      break;
    }
  }
  return line;
}

Line velocity_of_melting(const Map& map, double time_s) {
  const std::vector<double>& velocities = map.axes.velocity_m_per_s;
  Line line(map.axes.pressure_pa.size());
  for (std::size_t p = 0; p < line.size(); ++p) {
    for (std::size_t v = 0; v < velocities.size(); ++v) {
      const double melted = map.melting_time_s[map.axes.node(p, v)];
      if (!(melted <= time_s)) continue;
      if (v == 0) break;
      // Interpolates the velocity between node v, which has melted by `time_s`, and the slower node v - 1. The melting
      // time is assumed to be a power of the velocity. If the slower node never melts, the exponent is that between the
      // nodes v and v + 1.
      const double before = map.melting_time_s[map.axes.node(p, v - 1)];
      const bool known = before > melted;
      const double faster = v + 1 < velocities.size() ? map.melting_time_s[map.axes.node(p, v + 1)] : melted;
      // Logarithm of the ratio of melting times of two neighbouring nodes.
      const double decay = known ? std::log(before / melted) : std::log(melted / faster);
      const double part = decay > 0.0 ? std::min(1.0, std::log(time_s / melted) / decay) : 0.0;
      line[p] = velocities[v] * std::pow(velocities[v - 1] / velocities[v], part);
      break;
    }
  }
  return line;
}

}  // namespace shearbus::map
