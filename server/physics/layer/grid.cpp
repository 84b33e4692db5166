#include "server/physics/layer/grid.hpp"

#include <cmath>

namespace shearbus::physics {

Grid::Grid(const GridOptions& options) {
  const int n = options.cells;
  const double r = options.grading;
  // Widths w r^j with sum h. expm1/log1p keep the quotient exact as r -> 1.
  const double ratio_sum = r == 1.0 ? n : std::expm1(n * std::log(r)) / (r - 1.0);
  width.resize(n);
  vertex.resize(n + 1);
  weight.assign(n + 1, 0.0);
  double w = options.thickness / ratio_sum;
  vertex[0] = 0.0;
  for (int j = 0; j < n; ++j) {
    width[j] = w;
    vertex[j + 1] = vertex[j] + w;
    weight[j] += 0.5 * w;
    weight[j + 1] += 0.5 * w;
    w *= r;
  }
}

}  // namespace shearbus::physics
