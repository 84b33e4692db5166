// Slide lines: the parts of two surfaces that face each other, and the weights of pressures and shear stresses on their
// nodes.
//
// A slide line has a soft and a hard surface whose nodes need not match. The soft nodes are the interface nodes: each
// carries a pressure and a shear stress. Along the soft surface the pressure p = sum N_i p_i is linear between the soft
// nodes, with the pressure p_i and the shape function N_i of node i. The pressure acts on both bodies through integrals
// over the part of the soft surface that the hard surface covers (segment to segment, as in mortar methods: Puso &
// Laursen, Comput. Methods Appl. Mech. Eng. 193 (2004) 601). With the normal n out of the soft body and the radius r (1
// in plane symmetry), p_i exerts the forces
//
//     on soft node j:  -p_i integral N_i N_j n r dl        on hard node j:  +p_i integral N_i N_j^hard n r dl
//
// The shape functions of each surface sum to 1 at every point, so the forces on the two sides cancel exactly, for any
// mesh, and a uniform pressure equals exactly the nodal forces of uniformly stressed bodies (patch test). The same
// weights give the rate at which the gap of node i opens. The shear stress of node i acts along the tangent t_i: on
// soft node i over its area A_i = integral N_i r dl, on hard node j with the weight integral N_i N_j^hard r dl.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "hydro_stub/lagrange/mesh.hpp"

namespace shearbus::lagrange {

// One side of a body. Its nodes run in the direction that has the body on the left; zones[s] is the zone of the body at
// the segment from nodes[s] to nodes[s + 1].
struct Surface {
  std::vector<int> nodes;  // a closed surface repeats its first node
  std::vector<int> zones;

  bool closed() const { return nodes.front() == nodes.back(); }
  std::size_t count() const { return nodes.size() - (closed() ? 1 : 0); }  // of nodes, each counted once
};
inline Surface surface(const Block& block, Side side) {
  return {block.side(side), block.side_zones(side)};
}

struct SlideLine {
  Surface soft;
  Surface hard;
  bool rubs = true;  // false: the surfaces slip freely on this line, whatever the interface law
};

struct PushWeight {
  int node;
  Vec2 weight;  // force on mesh node `node` per unit pressure of the interface node  [m2]
};
struct RowWeight {
  // index of an interface node on the same slide line as the node i that has this weight; may be i itself
  int row;
  // integral of N_i N_row r dl: the shape functions of the two nodes and the radius (1 in plane symmetry)  [m2]
  double weight;
};
struct RubWeight {
  int node;
  double weight;  // force on the hard node `node` per unit shear stress of the interface node  [m2]
};
struct ZoneShare {
  int zone;
  // An interface node gives heat to zones of both bodies. This is the zone's fraction of the heat for its body; the
  // fractions of the zones of one body sum to 1.
  double share;
};

// Adds `amount` to the member `value` of the entry whose member `key` is `of`; creates the entry if it is missing.
template <class Entry, class Value>
void add(std::vector<Entry>& entries, int Entry::*key, Value Entry::*value, int of, Value amount) {
  const auto found = std::ranges::find(entries, of, key);
  if (found != entries.end()) {
    (*found).*value += amount;
    return;
  }
  Entry entry{};
  entry.*key = of;
  entry.*value = amount;
  entries.push_back(entry);
}

// The weights of the interface nodes of all slide lines, computed for given positions of the nodes.
class InterfaceWeights {
 public:
  InterfaceWeights(Symmetry symmetry, std::vector<SlideLine> lines);

  void find(const std::vector<Vec2>& position);

  // The interface nodes i = 0 ... size() - 1: first the rubbing() nodes of lines with friction, in the order of the
  // lines, then the nodes of the other lines.
  int size() const { return static_cast<int>(rows_.size()); }
  int rubbing() const { return rubbing_; }
  int node(int i) const { return rows_[i].node; }  // mesh node of interface node i
  // Returns the two soft zones that meet at interface node i; at an end of the surface both are the same zone.
  std::array<int, 2> zones_at(int i) const { return rows_[i].zones_at; }
  bool faces(int i) const { return rows_[i].area > 0.0; }  // true if the hard surface covers part of the node's area
  double area(int i) const { return rows_[i].area; }  // part of the node's area that the hard surface covers, A_i  [m2]
  // share of the node's area that the hard surface covers
  double covered(int i) const { return rows_[i].area / rows_[i].whole_area; }
  // mean gap over the covered area A_i, negative where the bodies overlap  [m]
  double gap(int i) const { return rows_[i].gap; }
  Vec2 tangent(int i) const { return rows_[i].tangent; }  // unit tangent, in the direction of the soft surface's nodes
  std::span<const PushWeight> push(int i) const { return rows_[i].push; }
  std::span<const RowWeight> overlap(int i) const { return rows_[i].overlap; }
  std::span<const RubWeight> rub(int i) const { return rows_[i].rub; }
  std::span<const ZoneShare> soft_zones(int i) const { return rows_[i].soft_zones; }
  std::span<const ZoneShare> hard_zones(int i) const { return rows_[i].hard_zones; }

 private:
  // The hard segments that are near each soft segment of a line. No result depends on when the list was made.
  struct Near {
    bool has_moved(const std::vector<Vec2>& position) const;

    std::vector<std::vector<int>> hard;  // of each soft segment
    std::vector<int> nodes;              // of both surfaces
    std::vector<Vec2> places;            // of these nodes when the list was made  [m]
    double slack = 0.0;                  // the list holds until a node has moved so far  [m]
  };

  // An interface node. All but the first two members are found for positions of the nodes.
  struct Row {
    int node;
    std::array<int, 2> zones_at;
    double area = 0.0, gap = 0.0;
    double whole_area = 0.0;  // covered or not: integral of N_i r dl over the soft surface  [m2]
    Vec2 normal_sum, tangent;
    std::vector<PushWeight> push;
    std::vector<RowWeight> overlap;
    std::vector<RubWeight> rub;
    std::vector<ZoneShare> soft_zones, hard_zones;

    void clear();
  };

  int row_after(std::size_t line, int segment) const;
  void find_near(const std::vector<Vec2>& position, std::size_t line);
  void pair_segments(const std::vector<Vec2>& position, std::size_t line, int soft_segment, int hard_segment);

  Symmetry symmetry_;
  std::vector<SlideLine> lines_;
  std::vector<Near> near_;  // of each line
  int rubbing_ = 0;
  std::vector<int> first_;  // index of the interface node at the first soft node of each line
  std::vector<Row> rows_;
};

}  // namespace shearbus::lagrange
