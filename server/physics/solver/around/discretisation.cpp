#include <algorithm>
#include <cmath>
#include <string>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

// Each cell of a graded grid is at most 1 + kGrowth sqrt(tolerance) times as wide as the cell before it: the error of
// conduction and that of the flow that gathers at z = 0 are of second order in (ratio of widths - 1), measured.
constexpr double kGrowth = 20.0;
// The same with a face that is held, which a slab feels seven times as much: the flux to it is exact, its way is not.
constexpr double kGrowthToHeldFace = 10.0;
constexpr double kMostGrowth = 1.0;  // largest (ratio of the widths of neighbouring cells) - 1
// The same of a layer that flows beside an interface that slips: coarser cells, which begin to flow one by one as the slip
// heats them, let slip and flow take over from each other too early or too late.
constexpr double kMostGrowthBesideSlip = 0.2;
// Cells behind the layer go on with its ratio, which leaves no error there that a tolerance of 1e-6 would show.
constexpr double kLeastExtensionGrading = 1.001;
// The first cells resolve the diffusion length of a short time, and therefore the skin in which the flow localises near
// melting.
constexpr double kShortTime = 1e-11;  // time whose diffusion length the first cells resolve, at tolerances >= 1e-3  [s]
constexpr double kShortestTime = 1e-14;       // least time that replaces kShortTime at small tolerances  [s]
constexpr double kShortTimeTolerance = 1e-3;  // a smaller tolerance t replaces kShortTime by kShortTime (t/1e-3)^3

constexpr double kKernelShare = 0.1;   // error of the heat kernel in a model with modes, relative to the tolerance
constexpr double kLongestTime = 1e-3;  // longest time that the modes represent  [s]; a half-space forgets older heat

// Makes cells that grow by a ratio g away from z = 0, from a first cell of (g - 1) delta, where delta is the diffusion
// length of a short time. The cells then resolve all diffusion lengths above delta alike: the width of each cell is
// (g - 1) times the distance of its near face from z = -delta.
GridOptions graded_for(GridOptions grid, double diffusivity, double growth, double tolerance) {
  const double part = std::min(1.0, tolerance / kShortTimeTolerance);
  const double short_time = std::max(kShortestTime, kShortTime * (part * part * part));
  // 1 + thickness / delta. This ratio is g to the power of the number of cells.
  const double ratio = 1.0 + grid.thickness / std::sqrt(diffusivity * short_time);
  grid.cells = std::max(2, static_cast<int>(std::ceil(std::log(ratio) / std::log(growth))));
  grid.grading = std::pow(ratio, 1.0 / grid.cells);
  grid.least_extension_grading = kLeastExtensionGrading;
  return grid;
}

}  // namespace

ModelOptions discretised(ModelOptions options, double tolerance) {
  options.tolerance = tolerance;
  const bool second_order = goes_with(Property::kSecondOrder, options) && !only_open_is_second_order(options) &&
                            !properties_of(options.soft.flow_law).first_order_in_time;
  options.time_integrator = second_order ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler;
  const bool held = options.grid.far_boundary == FarBoundary::kIsothermal ||
                    (options.hard_grid && options.hard_grid->far_boundary == FarBoundary::kIsothermal);
  const double growth = 1.0 + std::min((held ? kGrowthToHeldFace : kGrowth) * std::sqrt(tolerance),
                                       options.plastic_layer ? kMostGrowthBesideSlip : kMostGrowth);
  options.grid = graded_for(options.grid, options.soft.diffusivity, growth, tolerance);
  if (options.hard_grid) {
    options.hard_grid->cells = options.grid.cells;
    options.hard_grid->grading = options.grid.grading;
    options.hard_grid->least_extension_grading = kLeastExtensionGrading;
  }
  options.modes.reset();
  if (goes_with(Property::kModes, options))
    options.modes = {
        .accuracy = kKernelShare * tolerance, .shortest_step = kShortestControlledStep, .longest_time = kLongestTime};
  return options;
}

std::string discretisation_of(const ModelOptions& options, std::size_t modes) {
  const char* steps = options.time_integrator == TimeIntegrator::kSdirk2
                          ? ", sdirk2 in as many substeps as a step takes"
                          : ", backward Euler in as many substeps as a step takes";
  if (modes > 0) return text_of("tolerance ", *options.tolerance, ": no cells but ", modes, " modes", steps);
  return text_of("tolerance ", *options.tolerance, ": ", options.grid.cells, " cells growing by ",
                 Digits{4, options.grid.grading}, steps);
}

}  // namespace shearbus::physics
