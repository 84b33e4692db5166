#include "hydro_stub/lagrange/slide_line.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace shearbus::lagrange {

InterfaceWeights::InterfaceWeights(Symmetry symmetry, std::vector<SlideLine> lines)
    : symmetry_(symmetry), lines_(std::move(lines)) {
  std::stable_partition(lines_.begin(), lines_.end(), [](const SlideLine& line) { return line.rubs; });
  for (const SlideLine& line : lines_) {
    first_.push_back(size());
    const std::vector<int>& zones = line.soft.zones;
    for (std::size_t i = 0; i < line.soft.count(); ++i) {
      const std::size_t before = i > 0 ? i - 1 : line.soft.closed() ? zones.size() - 1 : 0;
      rows_.push_back({.node = line.soft.nodes[i], .zones_at = {zones[before], zones[std::min(i, zones.size() - 1)]}});
    }
    if (line.rubs) rubbing_ = size();
  }
  near_.resize(lines_.size());
}

void InterfaceWeights::Row::clear() {
  area = gap = whole_area = 0.0;
  normal_sum = {};
  push.clear();
  overlap.clear();
  rub.clear();
  soft_zones.clear();
  hard_zones.clear();
}

void InterfaceWeights::find(const std::vector<Vec2>& position) {
  for (Row& row : rows_) row.clear();
  for (std::size_t line = 0; line < lines_.size(); ++line) {
    if (near_[line].has_moved(position)) find_near(position, line);
    const int soft_segments = static_cast<int>(lines_[line].soft.zones.size());
    const int* hard = lines_[line].hard.nodes.data();
    for (int s = 0; s < soft_segments; ++s) {
      const Vec2 a = position[lines_[line].soft.nodes[s]];
      const Vec2 b = position[lines_[line].soft.nodes[s + 1]];
      const bool axisymmetric = symmetry_ == Symmetry::kAxisymmetric;
      rows_[first_[line] + s].whole_area += norm(b - a) * (axisymmetric ? (2.0 * a.x + b.x) / 6.0 : 0.5);
      rows_[row_after(line, s)].whole_area += norm(b - a) * (axisymmetric ? (a.x + 2.0 * b.x) / 6.0 : 0.5);
      for (const int h : near_[line].hard[s]) {  // the segments that are near enough to face each other
        const Vec2 p = position[hard[h]];
        const Vec2 q = position[hard[h + 1]];
        const Vec2 apart = (p + q) - (a + b);
        if (dot(apart, apart) <= 8.0 * (dot(b - a, b - a) + dot(q - p, q - p))) pair_segments(position, line, s, h);
      }
    }
  }
  for (Row& row : rows_) {
    if (!(row.area > 0.0)) continue;
    row.gap /= row.area;
    row.tangent = (1.0 / norm(row.normal_sum)) * left_of(row.normal_sum);
    for (ZoneShare& zone : row.soft_zones) zone.share /= row.area;
    for (ZoneShare& zone : row.hard_zones) zone.share /= row.area;
  }
}

bool InterfaceWeights::Near::has_moved(const std::vector<Vec2>& position) const {
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const Vec2 moved = position[nodes[n]] - places[n];
    if (!(dot(moved, moved) <= slack * slack)) return true;
  }
  return nodes.empty();
}

// Lists for each soft segment the hard segments that can pass the test of find() until a node has moved by the slack d:
// the sum of the two ends' distances then changes by 4 d at most, and the root of its bound by 8 d.
void InterfaceWeights::find_near(const std::vector<Vec2>& position, std::size_t line) {
  const Surface& soft = lines_[line].soft;
  const Surface& hard = lines_[line].hard;
  Near& near = near_[line];
  near.nodes = soft.nodes;
  near.nodes.insert(near.nodes.end(), hard.nodes.begin(), hard.nodes.end());
  near.places.clear();
  for (const int n : near.nodes) near.places.push_back(position[n]);
  double whole = 0.0;
  for (std::size_t s = 0; s < soft.zones.size(); ++s)
    whole += norm(position[soft.nodes[s + 1]] - position[soft.nodes[s]]);
  near.slack = 0.25 * whole / static_cast<double>(soft.zones.size());
  near.hard.resize(soft.zones.size());
  for (std::size_t s = 0; s < soft.zones.size(); ++s) {
    near.hard[s].clear();
    const Vec2 a = position[soft.nodes[s]];
    const Vec2 b = position[soft.nodes[s + 1]];
    for (std::size_t h = 0; h < hard.zones.size(); ++h) {
      const Vec2 p = position[hard.nodes[h]];
      const Vec2 q = position[hard.nodes[h + 1]];
      const double bound = std::sqrt(8.0 * (dot(b - a, b - a) + dot(q - p, q - p))) + 12.0 * near.slack;
      const Vec2 apart = (p + q) - (a + b);
      if (dot(apart, apart) <= bound * bound) near.hard[s].push_back(static_cast<int>(h));
    }
  }
}

// Returns the interface node at the end of a soft segment; on a closed surface the last segment ends at the first node.
int InterfaceWeights::row_after(std::size_t line, int segment) const {
  return first_[line] + (segment + 1) % static_cast<int>(lines_[line].soft.count());
}

// Adds the part of a soft segment a -> b that a hard segment p -> q covers, seen along the soft segment's normal, to
// the weights (area, gap, normal, zones, forces). Two Gauss points are exact for two shape functions times the radius.
void InterfaceWeights::pair_segments(const std::vector<Vec2>& position, std::size_t line, int s, int h) {
  const Surface& soft = lines_[line].soft;
  const Surface& hard = lines_[line].hard;
  const std::array<int, 2> soft_nodes = {soft.nodes[s], soft.nodes[s + 1]};
  const std::array<int, 2> hard_nodes = {hard.nodes[h], hard.nodes[h + 1]};
  const Vec2 a = position[soft_nodes[0]];
  const Vec2 ab = position[soft_nodes[1]] - a;
  const Vec2 p = position[hard_nodes[0]] - a;
  const Vec2 pq = position[hard_nodes[1]] - position[hard_nodes[0]];
  const double square = dot(ab, ab);
  const double reach = square + dot(pq, pq);
  if (!(dot(ab, pq) < 0.0)) return;

  const double at_p = dot(p, ab) / square;  // place of p along the soft segment, from 0 at a to 1 at b
  const double at_q = dot(p + pq, ab) / square;
  const double from = std::max(0.0, at_q);
  const double to = std::min(1.0, at_p);
  constexpr double kSliver = 1e-12;
  if (!(to - from > kSliver)) return;

  const double length = std::sqrt(square);
  const Vec2 normal = (1.0 / length) * right_of(ab);
  const double nearest = 0.25 * std::sqrt(reach);
  constexpr double kGauss = 0.28867513459481287;
  struct Sums {
    double part = 0.0, gap = 0.0;
    std::array<double, 2> soft{}, hard{};  // of products with the shape functions of both surfaces
  };
  std::array<Sums, 2> sums;  // of the two soft nodes
  for (const double side : {-kGauss, kGauss}) {
    const double xi = from + (0.5 + side) * (to - from);
    const double eta = (at_p - xi) / (at_p - at_q);
    const Vec2 on_hard = p + eta * pq;
    const double gap = dot(normal, on_hard);
    if (gap < -nearest) continue;  // the hard segment lies on the far side of a thin body
    const double radius = symmetry_ == Symmetry::kAxisymmetric ? a.x + xi * ab.x : 1.0;
    const double weight = 0.5 * (to - from) * length * radius;
    const std::array<double, 2> shape = {1.0 - xi, xi};
    for (int k = 0; k < 2; ++k) {
      const double part = shape[k] * weight;
      sums[k].part += part;
      sums[k].gap += part * gap;
      sums[k].soft[0] += part * shape[0];
      sums[k].soft[1] += part * shape[1];
      sums[k].hard[0] += part * (1.0 - eta);
      sums[k].hard[1] += part * eta;
    }
  }
  const std::array<int, 2> row = {first_[line] + s, row_after(line, s)};
  for (int k = 0; k < 2; ++k) {
    const Sums& sum = sums[k];
    if (sum.part == 0.0) continue;
    Row& own = rows_[row[k]];
    own.area += sum.part;
    own.gap += sum.gap;
    own.normal_sum += sum.part * normal;
    add(own.soft_zones, &ZoneShare::zone, &ZoneShare::share, soft.zones[s], sum.part);
    add(own.hard_zones, &ZoneShare::zone, &ZoneShare::share, hard.zones[h], sum.part);
    for (int m = 0; m < 2; ++m) {
      add(own.push, &PushWeight::node, &PushWeight::weight, soft_nodes[m], -sum.soft[m] * normal);
      add(own.push, &PushWeight::node, &PushWeight::weight, hard_nodes[m], sum.hard[m] * normal);
      add(own.overlap, &RowWeight::row, &RowWeight::weight, row[m], sum.soft[m]);
      add(own.rub, &RubWeight::node, &RubWeight::weight, hard_nodes[m], sum.hard[m]);
    }
  }
}

}  // namespace shearbus::lagrange
