#include "server/physics/layer/conduction.hpp"

#include <cmath>
#include <cstddef>

namespace shearbus::physics {

HeatGrid::HeatGrid(const Grid& grid, FarBoundary far_boundary) : width(grid.width) {
  if (far_boundary == FarBoundary::kHalfSpace) {
    const double thickness = grid.vertex.back();
    double depth = thickness;
    while (depth < kExtensionDepth * thickness) {
      width.push_back(width.back() * kExtensionGrading);
      depth += width.back();
    }
  }
  weight = grid.weight;
  if (width.size() == grid.width.size()) return;
  weight.pop_back();
  for (std::size_t i = grid.width.size(); i < width.size(); ++i) weight.push_back(std::sqrt(width[i - 1] * width[i]));
  weight.push_back(0.5 * width.back());
}

HeatOperator::HeatOperator(const HeatGrid& grid, const Material& material, double step) : dt(step) {
  const std::size_t n = grid.weight.size();
  const double diffused = material.diffusivity * dt;  // [m2]
  forward.resize(n);
  inverse_pivot.resize(n);
  backward.resize(n);
  response.assign(n, 0.0);

  // pivot = 1 + excess + c, with excess = a (1 + excess before) / (pivot before): the elimination's 1 + a + c - a
  // c/pivot written without the difference.
  double excess = 0.0;
  double pivot_before = 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double a = i == 0 ? 0.0 : diffused / (grid.weight[i] * grid.width[i - 1]);
    const double c = i + 1 == n ? 0.0 : diffused / (grid.weight[i] * grid.width[i]);
    excess = i == 0 ? 0.0 : a * (1.0 + excess) / pivot_before;
    const double pivot = 1.0 + excess + c;
    forward[i] = a / pivot;
    inverse_pivot[i] = 1.0 / pivot;
    backward[i] = c / pivot;
    pivot_before = pivot;
  }

  // Unit flux enters the half cell at z = 0: DLP (31), corrected, for any first width.
  response[0] = diffused / (grid.weight[0] * material.conductivity) * inverse_pivot[0];
  for (std::size_t i = 1; i < n; ++i) response[i] = forward[i] * response[i - 1];
  for (std::size_t i = n - 1; i-- > 0;) response[i] += backward[i] * response[i + 1];
}

// Both sweeps work on the temperature above that of the far vertex, the coldest: a uniform layer stays uniform to the
// last bit and no vertex falls below the coldest by rounding.
void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after) {
  const double* forward = heat.forward.data();
  const double* inverse_pivot = heat.inverse_pivot.data();
  const double* backward = heat.backward.data();
  const std::ptrdiff_t n = num_vertices;
  double far[kLanes];
  double t[kLanes] = {};
  for (int l = 0; l < kLanes; ++l) far[l] = before[(n - 1) * kLanes + l];
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] = (before[i * kLanes + l] - far[l]) * inverse_pivot[i] + forward[i] * t[l];
      after[i * kLanes + l] = t[l];
    }
  }
  for (int l = 0; l < kLanes; ++l) after[(n - 1) * kLanes + l] = far[l] + t[l];
  for (std::ptrdiff_t i = n - 1; i-- > 0;) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] = after[i * kLanes + l] + backward[i] * t[l];
      after[i * kLanes + l] = far[l] + t[l];
    }
  }
}

void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature) {
  const std::ptrdiff_t n = num_vertices;
  double* T = temperature + lane;
  const double far = T[(n - 1) * kLanes];
  double t = 0.0;
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    t = (T[i * kLanes] - far) * heat.inverse_pivot[i] + heat.forward[i] * t;
    T[i * kLanes] = t;
  }
  T[(n - 1) * kLanes] = far + t;
  for (std::ptrdiff_t i = n - 1; i-- > 0;) {
    t = T[i * kLanes] + heat.backward[i] * t;
    T[i * kLanes] = far + t;
  }
}

void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature) {
  for (std::ptrdiff_t i = 0; i < num_vertices; ++i) {
    for (int l = 0; l < kLanes; ++l) temperature[i * kLanes + l] += flux[l] * heat.response[i];
  }
}

void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature) {
  for (std::ptrdiff_t i = 0; i < num_vertices; ++i) temperature[i * kLanes + lane] += flux * heat.response[i];
}

}  // namespace shearbus::physics
