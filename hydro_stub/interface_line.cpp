#include "hydro_stub/interface_line.hpp"

#include <numeric>

namespace shearbus::hydro {

InterfaceLine::InterfaceLine(const lagrange::Bodies& bodies) {
  const std::vector<lagrange::Vec2>& place = bodies.mesh.places();
  std::size_t first = 0;  // interface node at the first soft node of the line
  for (const lagrange::SlideLine& line : bodies.slide_lines) {
    if (!line.rubs) continue;
    const std::vector<int>& soft = line.soft.nodes;
    const std::size_t count = line.soft.count();
    for (std::size_t s = 0; s + 1 < soft.size(); ++s)
      segments_.push_back(
          {.from = first + s, .to = first + (s + 1) % count, .length = norm(place[soft[s + 1]] - place[soft[s]])});
    first += count;
  }
  lengths_.assign(first, 0.0);
  for (const Segment& segment : segments_) {
    lengths_[segment.from] += 0.5 * segment.length;
    lengths_[segment.to] += 0.5 * segment.length;
  }
}

double InterfaceLine::mean(const std::vector<double>& values) const {
  return std::inner_product(values.begin(), values.end(), lengths_.begin(), 0.0) /
         std::accumulate(lengths_.begin(), lengths_.end(), 0.0);
}

std::optional<double> InterfaceLine::mean(const std::vector<double>& values,
                                          const std::function<bool(std::size_t)>& in_window) const {
  double sum = 0.0, length = 0.0;
  for (const Segment& segment : segments_) {
    if (!in_window(segment.from) || !in_window(segment.to)) continue;
    sum += 0.5 * segment.length * (values[segment.from] + values[segment.to]);
    length += segment.length;
  }
  if (length > 0.0) return sum / length;
  std::size_t nodes = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!in_window(i)) continue;
    sum += values[i];
    ++nodes;
  }
  if (nodes == 0) return std::nullopt;
  return sum / static_cast<double>(nodes);
}

}  // namespace shearbus::hydro
