// The grid across the shear layer, z = 0 at the interface.
#pragma once

#include <vector>

namespace shearbus::physics {

inline constexpr int kMaxBasisVertices = 1000;  // that conduct, of nodes that sleep: their modes are a square matrix

enum class FarBoundary { kInsulated, kHalfSpace };

struct GridOptions {
  double thickness = 20e-6;  // h [m]
  int cells = 500;
  double grading = 1.0;  // ratio of neighbouring cells, growing from z = 0
  FarBoundary far_boundary = FarBoundary::kInsulated;
  // Graded cells conduct a little less, so that z = 0 feels the body and not the grading; what lies behind goes on with
  // the same grading (MODEL.md section 3c).
  bool matched = false;
};

struct Grid {
  explicit Grid(const GridOptions& options);

  int num_cells() const { return static_cast<int>(width.size()); }
  int num_vertices() const { return num_cells() + 1; }

  double grading;
  bool matched;

  std::vector<double> width;   // of each cell, from the interface outward  [m]
  std::vector<double> vertex;  // z of each vertex                          [m]
  std::vector<double> weight;  // of each vertex in an integral over the layer: half of its two cells  [m]
};

}  // namespace shearbus::physics
