// The topology of the mesh. Zones are quadrilaterals with their nodes counter-clockwise; corner k of zone z is
// number 4 z + k, and so is the edge from node k to node k + 1:
//
//      3 ---(2)--- 2
//      |           |
//     (3)    z    (1)         A block has nx by ny zones, with index i to the right and j upward. Blocks share no
//      |           |          nodes: bodies meet on slide lines only.
//      0 ---(0)--- 1
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <vector>

#include "hydro_stub/lagrange/vec2.hpp"

namespace shearbus::lagrange {

// Loops over fewer nodes or zones use one thread, since waking other threads costs more time than these save.
inline constexpr int kFewestForThreads = 4000;

// Zones next to each other in a row of a block. Loops over the zones of a run vectorise: their numbers are consecutive,
// and so are the nodes below and above them.
struct Run {
  static constexpr int kMostZones = 64;
  int first = 0;  // number of the first zone
  int count = 0;
  int block = 0;
};

// A vector at each node of the zones of a run. The corners 0 and 1 of zone i of the run are the places i and i + 1 of the
// lower row, its corners 3 and 2 those of the upper row.
struct RunNodes {
  double x[2][Run::kMostZones + 1];
  double y[2][Run::kMostZones + 1];
  Vec2 corner(int k, int i) const {
    const int at = i + (k == 1 || k == 2 ? 1 : 0);
    return {x[k / 2][at], y[k / 2][at]};
  }
};

// A number at each corner of all zones, one array for each of the four corners: loops over zones vectorise.
class CornerNumbers {
 public:
  explicit CornerNumbers(int zones) : zones_(zones), values_(4 * zones_) {}
  double* operator[](int k) { return values_.data() + k * zones_; }
  const double* operator[](int k) const { return values_.data() + k * zones_; }

 private:
  std::size_t zones_;
  std::vector<double> values_;
};
struct CornerVectors {
  explicit CornerVectors(int zones) : x(zones), y(zones) {}
  Vec2 at(int zone, int k) const { return {x[k][zone], y[k][zone]}; }

  CornerNumbers x, y;
};

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
  int neighbour(int zone, int k) const { return neighbours_[k][zone]; }

  // All zones, in runs that end with the rows of the blocks.
  const std::vector<Run>& runs() const { return runs_; }
  // The values of a node quantity at the nodes of a run.
  void load(const std::vector<Vec2>& of_nodes, const Run& run, RunNodes& at) const;

  // Sums a corner quantity onto the nodes of one row of nodes of a block. Each node adds its corners in the order of
  // their zones.
  struct NodeRow {
    int block = 0;
    int j = 0;
    int first = 0;  // number of the first node
    int count = 0;
  };
  const std::vector<NodeRow>& node_rows() const { return node_rows_; }
  int longest_row() const { return longest_row_; }  // of nodes
  void gather(const CornerVectors& corner, const NodeRow& row, double* x, double* y) const;
  // Sums a quantity of all corners, at [4 * zone + k], onto the nodes.
  void gather(const std::vector<double>& corner, std::vector<double>& node) const;

 private:
  void add_zones(const Block& block);
  void check_zones(const Block& block) const;
  void add_runs(const Block& block);

  Symmetry symmetry_;
  std::vector<Block> blocks_;
  std::vector<Vec2> places_;
  std::vector<int> zone_nodes_;
  std::array<std::vector<int>, 4> neighbours_;  // zone on the other side of edge k at [k][zone], or -1
  std::vector<Run> runs_;
  std::vector<NodeRow> node_rows_;
  int longest_row_ = 0;
};

}  // namespace shearbus::lagrange
