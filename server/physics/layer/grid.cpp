#include "server/physics/layer/grid.hpp"

namespace shearbus::physics {

Grid::Grid(const GridOptions& options)
    : grading(options.grading), least_extension_grading(options.least_extension_grading) {
  const int n = options.cells;
  const double r = options.grading;
  // The widths of the cells are w r^j and add up to the thickness h. The sum is formed term by term: powers in its
  // closed form would depend on the last bits of the C library's results.
  double ratio_sum = 0.0;
  double ratio = 1.0;
  for (int j = 0; j < n; ++j, ratio *= r) ratio_sum += ratio;
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
