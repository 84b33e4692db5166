#include "hydro_stub/lagrange/mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "server/physics/layer/wide.hpp"

namespace shearbus::lagrange {

std::vector<int> Block::side(Side side) const {
  std::vector<int> nodes;
  if (side == Side::kBottom || side == Side::kTop) {
    for (int i = 0; i <= nx; ++i) nodes.push_back(side == Side::kBottom ? node(i, 0) : node(nx - i, ny));
  } else {
    for (int j = 0; j <= ny; ++j) nodes.push_back(side == Side::kRight ? node(nx, j) : node(0, ny - j));
  }
  return nodes;
}

std::vector<int> Block::side_zones(Side side) const {
  std::vector<int> zones;
  if (side == Side::kBottom || side == Side::kTop) {
    for (int i = 0; i < nx; ++i) zones.push_back(side == Side::kBottom ? zone(i, 0) : zone(nx - 1 - i, ny - 1));
  } else {
    for (int j = 0; j < ny; ++j) zones.push_back(side == Side::kRight ? zone(nx - 1, j) : zone(0, ny - 1 - j));
  }
  return zones;
}

const Block& Mesh::add_block(int nx, int ny, const std::function<Vec2(int, int)>& place, bool ring) {
  if (nx < 1 || ny < 1 || (ring && nx < 3)) {
    throw std::invalid_argument(fmt::format("a block of {} by {} zones; at least 1 by 1, a ring 3 by 1", nx, ny));
  }
  const Block block{.nx = nx, .ny = ny, .ring = ring, .first_node = num_nodes(), .first_zone = num_zones()};
  for (int j = 0; j <= ny; ++j) {
    for (int i = 0; i < block.columns(); ++i) places_.push_back(place(i, j));
  }
  add_zones(block);
  check_zones(block);
  add_runs(block);
  blocks_.push_back(block);
  return blocks_.back();
}

void Mesh::add_zones(const Block& b) {
  const auto zone = [&](int i, int j) {
    if (j < 0 || j >= b.ny) return -1;
    if (i >= 0 && i < b.nx) return b.zone(i, j);
    return b.ring ? b.zone((i + b.nx) % b.nx, j) : -1;
  };
  for (int j = 0; j < b.ny; ++j) {
    for (int i = 0; i < b.nx; ++i) {
      zone_nodes_.insert(zone_nodes_.end(), {b.node(i, j), b.node(i + 1, j), b.node(i + 1, j + 1), b.node(i, j + 1)});
      const std::array<int, 4> beside = {zone(i, j - 1), zone(i + 1, j), zone(i, j + 1), zone(i - 1, j)};
      for (std::size_t k = 0; k < 4; ++k) neighbours_[k].push_back(beside[k]);
    }
  }
}

void Mesh::check_zones(const Block& block) const {
  for (int zone = block.first_zone; zone < block.first_zone + block.num_zones(); ++zone) {
    const int* n = zone_nodes(zone);
    for (int k = 0; k < 4; ++k) {
      const Vec2 x = places_[n[k]];
      if (symmetry_ == Symmetry::kAxisymmetric && x.x < 0.0) {
        throw std::invalid_argument(fmt::format("node {} has radius {} m; axisymmetric meshes need r >= 0", n[k], x.x));
      }
      if (!(cross(places_[n[(k + 1) % 4]] - x, places_[n[(k + 3) % 4]] - x) > 0.0)) {
        throw std::invalid_argument(fmt::format(
            "zone {} is not convex and counter-clockwise at its corner {} (x = {}, y = {})", zone, k, x.x, x.y));
      }
    }
  }
}

void Mesh::add_runs(const Block& block) {
  const int number = static_cast<int>(blocks_.size());
  for (int j = 0; j < block.ny; ++j) {
    for (int i = 0; i < block.nx; i += Run::kMostZones) {
      runs_.push_back({.first = block.zone(i, j), .count = std::min(Run::kMostZones, block.nx - i), .block = number});
    }
  }
  for (int j = 0; j <= block.ny; ++j)
    node_rows_.push_back({.block = number, .j = j, .first = block.node(0, j), .count = block.columns()});
  longest_row_ = std::max(longest_row_, block.nx + 1);
}

namespace {

SHEARBUS_WIDE void take_apart(const Vec2* from, int count, double* __restrict x, double* __restrict y) {
  for (int i = 0; i < count; ++i) {
    x[i] = from[i].x;
    y[i] = from[i].y;
  }
}

SHEARBUS_WIDE void add_all(const double* from, int count, double* __restrict to) {
  for (int i = 0; i < count; ++i) to[i] += from[i];
}

}  // namespace

void Mesh::load(const std::vector<Vec2>& of_nodes, const Run& run, RunNodes& at) const {
  const int* begin = zone_nodes(run.first);
  const int* last = zone_nodes(run.first + run.count - 1);
  for (const int row : {0, 1}) {
    take_apart(of_nodes.data() + begin[row == 0 ? 0 : 3], run.count, at.x[row], at.y[row]);
    const Vec2 end = of_nodes[last[row == 0 ? 1 : 2]];  // in a ring the first node of the row
    at.x[row][run.count] = end.x;
    at.y[row][run.count] = end.y;
  }
}

void Mesh::gather(const CornerVectors& corner, const NodeRow& row, double* x, double* y) const {
  const Block& block = blocks_[row.block];
  const int nx = block.nx;
  std::fill_n(x, nx + 1, 0.0);
  std::fill_n(y, nx + 1, 0.0);
  const auto add = [&](int k, int j, int shift) {
    add_all(corner.x[k] + block.zone(0, j), nx, x + shift);
    add_all(corner.y[k] + block.zone(0, j), nx, y + shift);
  };
  if (row.j > 0) {
    add(2, row.j - 1, 1);
    add(3, row.j - 1, 0);
  }
  if (row.j < block.ny) {
    add(1, row.j, 1);
    add(0, row.j, 0);
  }
  if (block.ring) {
    x[0] += x[nx];
    y[0] += y[nx];
  }
}

void Mesh::gather(const std::vector<double>& corner, std::vector<double>& node) const {
  std::ranges::fill(node, 0.0);
  for (std::size_t c = 0; c < corner.size(); ++c) node[zone_nodes_[c]] += corner[c];
}

}  // namespace shearbus::lagrange
