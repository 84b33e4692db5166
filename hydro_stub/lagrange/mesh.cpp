#include "hydro_stub/lagrange/mesh.hpp"

#include <fmt/format.h>

#include <stdexcept>

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
  index_corners();
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
      neighbours_.insert(neighbours_.end(), {zone(i, j - 1), zone(i + 1, j), zone(i, j + 1), zone(i - 1, j)});
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

void Mesh::index_corners() {
  corner_first_.assign(places_.size() + 1, 0);
  for (const int node : zone_nodes_) ++corner_first_[node + 1];
  for (std::size_t n = 0; n < places_.size(); ++n) corner_first_[n + 1] += corner_first_[n];
  corner_of_node_.assign(zone_nodes_.size(), 0);
  std::vector<int> next(corner_first_.begin(), corner_first_.end() - 1);
  for (std::size_t c = 0; c < zone_nodes_.size(); ++c) corner_of_node_[next[zone_nodes_[c]]++] = static_cast<int>(c);
}

namespace {

template <class T>
void gather_corners(const std::vector<int>& first, const std::vector<int>& corners, const std::vector<T>& corner,
                    std::vector<T>& node) {
  const int num_nodes = static_cast<int>(node.size());
#pragma omp parallel for schedule(static) if (num_nodes >= kFewestForThreads)
  for (int n = 0; n < num_nodes; ++n) {
    T sum{};
    for (int c = first[n]; c < first[n + 1]; ++c) sum += corner[corners[c]];
    node[n] = sum;
  }
}

}  // namespace

void Mesh::gather(const std::vector<Vec2>& corner, std::vector<Vec2>& node) const {
  gather_corners(corner_first_, corner_of_node_, corner, node);
}
void Mesh::gather(const std::vector<double>& corner, std::vector<double>& node) const {
  gather_corners(corner_first_, corner_of_node_, corner, node);
}

}  // namespace shearbus::lagrange
