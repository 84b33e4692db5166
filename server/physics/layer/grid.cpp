#include "server/physics/layer/grid.hpp"

#include <cmath>
#include <cstdio>

namespace shearbus::physics {

std::string grid_fault(const GridOptions& options) {
  constexpr double kThinnest = 1e-9;  // share of the thickness
  if (!(options.thickness > 0.0) || !std::isfinite(options.thickness))
    return "the thickness must be above 0 and finite";
  if (options.cells < 1) return "there must be at least 1 cell";
  if (!(options.grading >= 1.0) || !std::isfinite(options.grading)) return "the grading must be at least 1 and finite";
  double sum = 0.0;
  double ratio = 1.0;
  for (int j = 0; j < options.cells && sum * kThinnest <= 1.0; ++j, ratio *= options.grading) sum += ratio;
  if (sum * kThinnest <= 1.0) return {};
  char text[200];
  std::snprintf(
      text, sizeof text,
      "%d cells graded by %g leave a first cell below %g of the thickness: take fewer cells or a grading nearer 1",
      options.cells, options.grading, kThinnest);
  return text;
}

Grid::Grid(const GridOptions& options) {
  const int n = options.cells;
  const double r = options.grading;
  // Widths w r^j with sum h. Summed, not by the closed form: its powers would take their last bits from the C library.
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
