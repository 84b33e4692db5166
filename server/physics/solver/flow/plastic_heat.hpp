// Where plastic work becomes heat (MODEL.md, "Plastic-work heating"): the shape phi of one lane, a column of
// [vertex][lane].
#pragma once

#include <cstddef>

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Fraction of the work that becomes heat: the sum of the heat shape phi over the vertices.
inline double heated_share(const Grid& grid, const double* shape) {
  double sum = 0.0;
  for (std::ptrdiff_t i = 0; i < grid.num_vertices(); ++i) sum += shape[i * kLanes];
  return sum;
}

// Computes the heat shape of one lane for the next step: for each vertex, the part of the work that becomes heat there.
// The parts follow where the slip of this step happened: plastic flow heats its vertex with the Taylor-Quinney fraction
// of its work, and `interface_slip` heats z = 0 with all its work. A step without slip keeps the shape.
inline void reshape_heat(const Problem& problem, const double* strain_old, const double* strain_new,
                         double interface_slip, double* shape) {
  const Grid& grid = problem.grid;
  double slip = interface_slip;
  for (std::ptrdiff_t i = 0; i < grid.num_vertices(); ++i)
    slip += grid.weight[static_cast<std::size_t>(i)] * (strain_new[i * kLanes] - strain_old[i * kLanes]);
  if (!(slip > 0.0)) return;
  const double factor = *problem.options.taylor_quinney_factor;
  for (std::ptrdiff_t i = 0; i < grid.num_vertices(); ++i) {
    const double weight = grid.weight[static_cast<std::size_t>(i)];
    shape[i * kLanes] = factor * (weight * (strain_new[i * kLanes] - strain_old[i * kLanes]) / slip);
  }
  shape[0] += interface_slip / slip;
}

}  // namespace shearbus::physics
