// The topology of the mesh. Zones are quadrilaterals with their nodes counter-clockwise; corner k of zone z is
// number 4 z + k, and so is the edge from node k to node k + 1:
//
//      3 ---(2)--- 2
//      |           |
//     (3)    z    (1)         A block has nx by ny zones, with index i to the right and j upward. Blocks share no
//      |           |          nodes: bodies meet on slide lines only.
//      0 ---(0)--- 1
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "hydro_stub/lagrange/vec2.hpp"

namespace shearbus::lagrange {

// Loops over fewer nodes or zones use one thread, since waking other threads costs more time than these save.
inline constexpr int kFewestForThreads = 4000;

// Sums over a mesh are per metre of depth (kPlane) or per radian about the axis x = r = 0 (kAxisymmetric).
enum class Symmetry { kPlane, kAxisymmetric };

enum class Side { kBottom, kRight, kTop, kLeft };  // the sides at j = 0, i = nx, j = ny, i = 0

struct Block {
  int nx = 0;
  int ny = 0;
  bool ring = false;  // true: the block is closed to a ring, where i = nx and i = 0 are the same column of nodes
  int first_node = 0;
  int first_zone = 0;

  int columns() const { return ring ? nx : nx + 1; }
  int node(int i, int j) const { return first_node + j * columns() + (ring ? (i + nx) % nx : i); }
  int zone(int i, int j) const { return first_zone + j * nx + i; }
  int num_zones() const { return nx * ny; }
  int num_nodes() const { return columns() * (ny + 1); }
  // Returns the nodes along a side, counter-clockwise with the block on the left. The bottom and top of a ring are
  // closed: their first node is repeated at the end.
  std::vector<int> side(Side side) const;
  // Returns the zone of the block at each segment of side().
  std::vector<int> side_zones(Side side) const;
};

class Mesh {
 public:
  explicit Mesh(Symmetry symmetry) : symmetry_(symmetry) {}

  // Makes a block with its node (i, j) at `place(i, j)`. Throws std::invalid_argument for a block with too few zones
  // and for a zone that is clockwise, not convex or, in axisymmetry, at a negative radius.
  const Block& add_block(int nx, int ny, const std::function<Vec2(int, int)>& place, bool ring = false);

  Symmetry symmetry() const { return symmetry_; }
  int num_nodes() const { return static_cast<int>(places_.size()); }
  int num_zones() const { return static_cast<int>(zone_nodes_.size() / 4); }
  const std::vector<Block>& blocks() const { return blocks_; }
  const std::vector<Vec2>& places() const { return places_; }  // initial positions of the nodes

  const int* zone_nodes(int zone) const { return zone_nodes_.data() + 4 * static_cast<std::size_t>(zone); }
  // Returns the zone on the other side of edge k of a zone; -1 if there is none in the block.
  int neighbour(int zone, int k) const { return neighbours_[4 * static_cast<std::size_t>(zone) + k]; }

  // Sums a corner quantity onto the nodes. Each node adds its corners in the same order for any number of threads.
  void gather(const std::vector<Vec2>& corner, std::vector<Vec2>& node) const;
  void gather(const std::vector<double>& corner, std::vector<double>& node) const;

 private:
  void add_zones(const Block& block);
  void check_zones(const Block& block) const;
  void index_corners();

  Symmetry symmetry_;
  std::vector<Block> blocks_;
  std::vector<Vec2> places_;
  std::vector<int> zone_nodes_;
  std::vector<int> neighbours_;    // zone on the other side of edge k at [4 * zone + k], or -1
  std::vector<int> corner_first_;  // index of each node's first corner in corner_of_node_
  std::vector<int> corner_of_node_;
};

}  // namespace shearbus::lagrange
