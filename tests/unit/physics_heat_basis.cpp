// The modes of a grid represent its heat (server/physics/METHODS.md, "Sleep"): the decay of the modes must equal steps
// of the heat operator.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/layer/heat_basis.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

TEST(PhysicsHeatBasis, ModesAreTheStepsOfTheOperator) {
  ModelOptions half_space = graded(paper_options());
  half_space.grid.far_boundary = FarBoundary::kHalfSpace;
  for (const ModelOptions& options : {half_space, two_sided(graded(paper_options())), paper_options()}) {
    const HeatGrid grid = Rig(options).heat_grid();
    const HeatBasis basis(grid, options.soft, options.hard);
    const int n = grid.num_vertices();
    const HeatOperator heat(grid, options.soft, options.hard, 3e-9);
    std::vector<double> rows(static_cast<std::size_t>(n) * kLanes, 300.0);
    double flux[kLanes] = {1e10, 1e9};
    for (int m = 0; m < 30; ++m) {
      add_flux(heat, n, flux, rows.data());
      conduct(heat, n, rows.data(), rows.data());
    }
    std::vector<double> modes = rows, back = rows;
    const int live = to_modes(basis, 0, modes.data());
    to_profile(basis, live, 0, modes.data(), back.data());
    double there_and_back = 0.0, stepped = 0.0, held = 0.0, kept = 0.0;
    for (int i = 0; i < n; ++i)
      there_and_back = std::max(there_and_back, std::abs(back[i * kLanes] - rows[i * kLanes]));
    EXPECT_LT(there_and_back, 1e-9);
    const std::vector<double> decay = basis.decay(3e-9, false);
    for (int m = 0; m < 50; ++m) {
      double T0[kLanes];
      interface_later(basis, decay.data(), live, modes.data(), T0);
      decay_modes(decay.data(), live, n, modes.data(), modes.data());
      conduct(heat, n, rows.data(), rows.data());
      stepped = std::max(stepped, std::abs(T0[0] - rows[grid.interface * kLanes]));
    }
    EXPECT_LT(stepped, 1e-9);
    to_profile(basis, live, 0, modes.data(), back.data());
    for (int i = 0; i < n; ++i) {
      const double capacity = grid.capacity(i, options.soft, options.hard);
      held += capacity * (rows[i * kLanes] - 300.0);
      kept += capacity * (back[i * kLanes] - 300.0);
    }
    EXPECT_NEAR(kept / held, 1.0, 1e-9);
  }
}

// Largest deviation of the modes from being orthogonal to each other.
double apart(const HeatBasis& basis) {
  const std::size_t n = basis.rate.size();
  double worst = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < n; ++j) {
      double sum = k == j ? -1.0 : 0.0;
      for (std::size_t i = 0; i < n; ++i) sum += basis.projection[k * n + i] * basis.shape[j * n + i];
      worst = std::max(worst, std::abs(sum));
    }
  }
  return worst;
}

// Any temperatures come back from their modes with the digits of the hottest of them: also behind a half-space, whose
// cells differ by 1e11 in width.
TEST(PhysicsHeatBasis, RoughProfilesComeBackToRounding) {
  for (const double growth : {1.0, 1.1, 1.3}) {
    for (const bool half_space : {false, true}) {
      ModelOptions options = graded(paper_options(), 60, growth);
      if (half_space)
        options.grid.far_boundary = FarBoundary::kHalfSpace;
      else
        options = two_sided(options);
      const HeatGrid grid = Rig(options).heat_grid();
      const HeatBasis basis(grid, options.soft, options.hard);
      EXPECT_LT(apart(basis), 1e-13) << growth;
      std::vector<double> rows(static_cast<std::size_t>(grid.num_vertices()) * kLanes);
      for (std::size_t i = 0; i < rows.size(); ++i)
        rows[i] = 300.0 + 900.0 * std::abs(std::sin(static_cast<double>(i * i)));
      std::vector<double> modes = rows, back = rows;
      to_profile(basis, to_modes(basis, 0, modes.data()), 0, modes.data(), back.data());
      for (std::size_t i = 0; i < rows.size(); i += kLanes) ASSERT_NEAR(back[i], rows[i], 1e-10) << i;
    }
  }
}

// The rates of a uniform slab are known: 4 alpha/dz^2 sin^2(k pi / (2 cells)). Each has the digits of its own size.
TEST(PhysicsHeatBasis, SlowRatesHaveTheirOwnDigits) {
  ModelOptions options = paper_options();
  options.grid.cells = 100;
  const HeatGrid grid = Rig(options).heat_grid();
  const HeatBasis basis(grid, options.soft, options.hard);
  const int cells = grid.num_vertices() - 1;
  const double fastest = 4.0 * options.soft.diffusivity / (grid.width[0] * grid.width[0]);
  EXPECT_EQ(basis.rate[0], 0.0);
  for (int k = 1; k <= cells; ++k) {
    const double root = std::sin(0.5 * M_PI * k / cells);
    EXPECT_NEAR(basis.rate[static_cast<std::size_t>(k)] / (fastest * root * root), 1.0, 1e-13) << k;
  }
}

// Two equal bodies that a vertex of enormous capacity separates have each rate twice, to the last digits: the two modes
// of a rate must still be different ones.
TEST(PhysicsHeatBasis, EqualRatesHaveTwoModes) {
  ModelOptions options = paper_options();
  options.grid.cells = 40;
  options.hard_grid = options.grid;
  options.hard = options.soft;
  HeatGrid grid = Rig(options).heat_grid();
  grid.hard_weight = 1e9 * grid.width[0];
  const HeatBasis basis(grid, options.soft, options.hard);
  double nearest = 1.0;
  for (std::size_t k = 2; k < basis.rate.size(); ++k)
    nearest = std::min(nearest, (basis.rate[k] - basis.rate[k - 1]) / basis.rate[k]);
  EXPECT_LT(nearest, 1e-9);
  EXPECT_LT(apart(basis), 1e-10);
}

}  // namespace
}  // namespace shearbus::testing
