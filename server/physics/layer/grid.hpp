// The grid across the shear layer, z = 0 at the interface.
#pragma once

#include <vector>

namespace shearbus::physics {

// Largest number of vertices of both bodies together if `[layer] sleep` is on: the modes of a HeatBasis are a square
// matrix of this order.
inline constexpr int kMaxBasisVertices = 1150;

// What lies behind the far face of a body: nothing, more of the body, or a bath that keeps the face at the temperature
// of the start.
enum class FarBoundary { kInsulated, kHalfSpace, kIsothermal };

struct GridOptions {
  double thickness = 20e-6;  // thickness h of the layer  [m]
  int cells = 500;
  double grading = 1.0;  // ratio of the widths of neighbouring cells, which grow from z = 0
  FarBoundary far_boundary = FarBoundary::kInsulated;
  double least_extension_grading = 1.1;  // least grading of the cells that a half-space adds behind graded cells
};

struct Grid {
  explicit Grid(const GridOptions& options);

  int num_cells() const { return static_cast<int>(width.size()); }
  int num_vertices() const { return num_cells() + 1; }

  double grading, least_extension_grading;

  std::vector<double> width;   // width of each cell, from the interface outward  [m]
  std::vector<double> vertex;  // z of each vertex                          [m]
  // Weight of each vertex in an integral over the layer: half the sum of the widths of its cells  [m]
  std::vector<double> weight;
};

}  // namespace shearbus::physics
