// The layer of one node, vertex by vertex, as its state has it: for pictures and comparison, no part of a step.
#include <algorithm>
#include <limits>
#include <vector>

#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {
namespace {

// Depths of the vertices of one body, from z = 0 outward. `width(i)` is the conduction length of the cell behind vertex
// i, which is longer than the cell behind a graded layer.
template <typename Width>
std::vector<double> depths_of(const GridOptions& options, std::size_t vertices, const Width& width) {
  const Grid grid(options);
  const double stretch = grid.grading == 1.0 ? 1.0 : conduction_stretch(extension_grading(grid));
  std::vector<double> depth = grid.vertex;
  while (depth.size() < vertices) depth.push_back(depth.back() + width(depth.size() - 1) / stretch);
  return depth;
}

}  // namespace

bool Model::keeps_profile() const {
  return !problem_->modes;
}

ProfileGrid Model::profile_grid() const {
  const Problem& problem = *problem_;
  const HeatGrid& heat = problem.heat_grid;
  ProfileGrid grid{.position = std::vector<double>(heat.weight.size()),
                   .width = {heat.weight.begin(), heat.weight.end()}};
  const auto interface = static_cast<std::size_t>(heat.interface);
  const std::vector<double> soft = depths_of(problem.options.grid, heat.weight.size() - interface,
                                             [&](std::size_t cell) { return heat.width[interface + cell]; });
  std::ranges::copy(soft, grid.position.begin() + heat.interface);
  if (interface == 0) return grid;
  const std::vector<double> hard = depths_of(*problem.options.hard_grid, interface + 1,
                                             [&](std::size_t cell) { return heat.width[interface - 1 - cell]; });
  for (std::size_t i = 1; i <= interface; ++i) grid.position[interface - i] = -hard[i];
  return grid;
}

void Model::profile(const double* tile, int lane, double pressure, const ProfileRows& rows) const {
  const Problem& problem = *problem_;
  constexpr double kOutside = std::numeric_limits<double>::quiet_NaN();
  const TileLayout& layout = problem.layout;
  const std::size_t vertices = problem.heat_grid.weight.size();
  std::vector<double> temperature(vertices * kLanes);
  profile_of(problem, tile, lane, temperature.data());
  const auto first = static_cast<std::size_t>(problem.heat_grid.interface);
  const auto layer = static_cast<std::size_t>(problem.grid.num_vertices());
  const Material soft = at_pressure(problem.options.soft, pressure);
  for (std::size_t i = 0; i < vertices; ++i) {
    const double T = temperature[i * kLanes + static_cast<std::size_t>(lane)];
    const bool inside = i >= first && i < first + layer;
    const std::size_t at = (i - first) * kLanes + static_cast<std::size_t>(lane);  // of a vertex of the layer
    rows.temperature[i] = T;
    if (rows.plastic_strain != nullptr) rows.plastic_strain[i] = inside ? tile[layout.plastic_strain + at] : kOutside;
    if (rows.flow_stress != nullptr)
      rows.flow_stress[i] = inside ? flow_stress(soft, tile[layout.plastic_strain + at], pressure, T) : kOutside;
    const std::size_t of_stress = layout.num_stress_vertices > 1 ? at : static_cast<std::size_t>(lane);
    rows.shear_stress[i] = inside ? tile[layout.shear_stress + of_stress] : kOutside;
    if (rows.second_shear_stress != nullptr)
      rows.second_shear_stress[i] = inside ? tile[layout.second_stress + static_cast<std::size_t>(lane)] : kOutside;
  }
}

}  // namespace shearbus::physics
