#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

// The exact temperature rise at z = 0 per unit flux in one step of backward Euler, on a uniform grid with an insulated
// end (server/physics/METHODS.md, "Conduction").
double exact_response(double dt, double dz, int cells, const Material& m) {
  const double Fo = m.diffusivity * dt / (dz * dz);
  const double theta = 2.0 * std::asinh(0.5 / std::sqrt(Fo));
  return std::sqrt(m.diffusivity * dt) / m.conductivity / std::sqrt(1.0 + 0.25 / Fo) / std::tanh(cells * theta);
}

TEST(PhysicsHeat, UnitResponseIsTheClosedForm) {
  const Material m = paper_options().soft;
  for (int cells : {1, 10, 500}) {
    const Grid grid({20e-6, cells, 1.0, FarBoundary::kInsulated});
    for (double dt : {1e-14, 1e-12, 1e-9, 1e-6, 1e-3}) {
      const HeatOperator heat(HeatGrid(grid, FarBoundary::kInsulated), m, dt);
      const double exact = exact_response(dt, 20e-6 / cells, cells, m);
      EXPECT_NEAR(heat.response[0] / exact, 1.0, 1e-12) << cells << " cells, dt " << dt;
    }
  }
  const HeatOperator paper(HeatGrid(Grid({}), FarBoundary::kInsulated), m, 1e-9);
  EXPECT_NEAR(paper.response[0], 1.8823463565e-9, 1e-19);
}

TEST(PhysicsHeat, ResponseHoldsExactlyTheHeatOfOneStep) {
  const Material m = paper_options().soft;
  for (double grading : {1.0, 1.08, 1.5}) {
    for (FarBoundary far : {FarBoundary::kInsulated, FarBoundary::kHalfSpace}) {
      const HeatGrid grid(Grid({20e-6, 60, grading, far}), far);
      for (double dt : {1e-12, 1e-9, 1e-5}) {
        const HeatOperator heat(grid, m, dt);
        double stored = 0.0;
        for (int i = 0; i < grid.num_vertices(); ++i) stored += grid.weight[i] * heat.response[i];
        EXPECT_NEAR(stored * m.conductivity / m.diffusivity / dt, 1.0, 2e-13) << grading << ", dt " << dt;
      }
    }
  }
}

// One step of backward Euler from a uniform temperature raises T0 per unit flux by d/k in a half-space, and by
// d/k coth(h/d) in an insulated slab, where d = sqrt(alpha dt). On a slab with d < h/10 cells that conduct over their
// own widths give less by a share of (ln grading)^2/16. The conduction lengths and the weights next to the far face
// correct this: the relative error is below 0.0015 (ln grading)^2 on either body, for any d.
TEST(PhysicsHeat, GradedCellsRespondAsTheBodyTheyDivide) {
  const Material m = paper_options().soft;
  const double h = 20e-6, first = 1e-9;
  for (const double grading : {1.05, 1.2, 1.5}) {
    const int cells = static_cast<int>(std::ceil(std::log(1.0 + h / first) / std::log(grading)));
    for (const FarBoundary far : {FarBoundary::kHalfSpace, FarBoundary::kInsulated}) {
      const HeatGrid matched(Grid({h, cells, grading, far, grading}), far);
      HeatGrid stiff = matched;
      for (double& width : stiff.width) width /= conduction_stretch(grading);
      const double log_grading = std::log(grading);
      for (const double dt : {1e-9, 1e-8, 1e-7, 1e-6, 1e-5}) {
        const double depth = std::sqrt(m.diffusivity * dt);
        const double exact = depth / m.conductivity / (far == FarBoundary::kInsulated ? std::tanh(h / depth) : 1.0);
        const double error = HeatOperator(matched, m, dt).response[0] / exact - 1.0;
        EXPECT_LT(std::abs(error), 1.5e-3 * log_grading * log_grading) << grading << " dt " << dt;
        if (depth > 0.1 * h || far == FarBoundary::kHalfSpace) continue;
        const double unmatched = HeatOperator(stiff, m, dt).response[0] / exact - 1.0;
        EXPECT_NEAR(unmatched / (-log_grading * log_grading / 16.0), 1.0, 0.15) << grading << " dt " << dt;
      }
    }
  }
}

// A slab whose far face is held carries d/k tanh(h/d), and a steady flux without an error of any grid.
TEST(PhysicsHeat, GradedCellsRespondAsTheSlabWithAHeldFace) {
  const Material m = paper_options().soft;
  const double h = 20e-6;
  for (const double grading : {1.0001, 1.1, 1.25, 1.7, 2.0}) {
    const int cells = grading < 1.01 ? 500 : static_cast<int>(std::log(h / 1e-9) / std::log(grading));
    const HeatGrid grid(Grid({h, cells, grading, FarBoundary::kIsothermal}), FarBoundary::kIsothermal);
    EXPECT_NEAR(std::accumulate(grid.width.begin(), grid.width.end(), 0.0) / h, 1.0, 1e-12);
    const double log_grading = std::log(grading);
    for (const double share : {0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 10.0}) {
      const double depth = share * h;
      const double exact = depth / m.conductivity * std::tanh(1.0 / share);
      const HeatOperator heat(grid, m, depth * depth / m.diffusivity);
      EXPECT_LT(std::abs(heat.response[0] / exact - 1.0), 1.1e-2 * log_grading * log_grading + 1e-4)
          << grading << share;
    }
    const HeatOperator steady(grid, m, 1e6);
    EXPECT_NEAR(steady.response[0] * m.conductivity / h, 1.0, 1e-9) << grading;
  }
}

// Heat that passes from the graded cells of a layer into those of the half-space behind it is reflected where the ratio
// of neighbouring cells changes: not at all where the cells behind go on with the same ratio, by 4e-5 where they grow
// faster because the layer's ratio is small.
TEST(PhysicsHeat, CellsBehindAGradedLayerReflectLittle) {
  const Material m = paper_options().soft;
  struct {
    int cells;
    double grading, most_error;
  } const layers[] = {{36, 1.2, 6e-6}, {60, 1.08, 4e-5}, {240, 1.02, 4e-5}, {500, 1.001, 6e-6}};
  for (const auto& [cells, grading, most_error] : layers) {
    const HeatGrid grid(Grid({20e-6, cells, grading, FarBoundary::kHalfSpace}), FarBoundary::kHalfSpace);
    EXPECT_LE(grid.num_vertices(), cells + 125);
    for (const double depth : {20e-6, 60e-6, 200e-6, 1e-3}) {
      const HeatOperator heat(grid, m, depth * depth / m.diffusivity);
      EXPECT_LT(std::abs(heat.response[0] * m.conductivity / depth - 1.0), most_error) << cells << ", depth " << depth;
    }
  }
}

TEST(PhysicsHeat, UniformTemperatureStaysToTheLastBit) {
  for (const ModelOptions& options : {graded(paper_options()), two_sided(graded(paper_options()))}) {
    Rig rig(options);
    rig.start({300.1, 317.3, 1e-3, 1219.999, 5000.0, 77.7, 300.0, 1e4});
    const std::vector<double> before = rig.committed;
    rig.set_all(0.0, 1e9);
    for (double dt : {1e-12, 1e-9, 1e-5}) rig.step(dt);
    for (std::size_t i = 0; i < rig.model.layout().shear_stress; ++i) ASSERT_EQ(rig.committed[i], before[i]) << i;
  }
}

// `add_flux` may skip a vertex only where the added heat would not change the bits of the temperature.
TEST(PhysicsHeat, FluxLeavesOutOnlyWhatKeepsItsBits) {
  ModelOptions two = two_sided(graded(paper_options()));
  for (const HeatGrid& grid : {HeatGrid(Grid({20e-6, 60, 1.08}), FarBoundary::kHalfSpace), Rig(two).heat_grid()}) {
    const int n = grid.num_vertices();
    for (double dt : {1e-11, 1e-9, 1e-6}) {
      const HeatOperator heat(grid, two.soft, two.hard, dt);
      for (double strongest : {0.0, 1.0, 1e6, 1e11}) {
        std::vector<double> tile(static_cast<std::size_t>(n) * kLanes);
        for (int i = 0; i < n; ++i)
          for (int l = 0; l < kLanes; ++l)
            tile[i * kLanes + l] = 1e-3 + 40.0 * l + 900.0 / (1.0 + 0.1 * std::abs(i - grid.interface));
        std::vector<double> one = tile;
        double flux[kLanes];
        for (int l = 0; l < kLanes; ++l) flux[l] = strongest * std::pow(10.0, -l);
        add_flux(heat, n, flux, tile.data());
        std::vector<double> everywhere = one;
        for (int i = 0; i < n; ++i)
          for (int l = 0; l < kLanes; ++l) everywhere[i * kLanes + l] += flux[l] * heat.response[i];
        for (int l = 0; l < kLanes; ++l) add_flux_lane(heat, n, l, flux[l], one.data());
        ASSERT_EQ(tile, everywhere) << "dt " << dt << ", " << strongest << " W/m2";
        ASSERT_EQ(one, everywhere) << "dt " << dt << ", " << strongest << " W/m2";
      }
    }
  }
}

TEST(PhysicsHeat, GridFillsTheLayer) {
  for (double grading : {1.0, 1.0 + 1e-12, 1.08, 2.0}) {
    const Grid grid({20e-6, 50, grading, FarBoundary::kInsulated});
    EXPECT_NEAR(grid.vertex.back() / 20e-6, 1.0, 1e-12) << grading;
    EXPECT_NEAR(std::accumulate(grid.weight.begin(), grid.weight.end(), 0.0) / 20e-6, 1.0, 1e-12) << grading;
    for (int j = 1; j < grid.num_cells(); ++j) EXPECT_NEAR(grid.width[j] / grid.width[j - 1], grading, 1e-9);
  }
}

}  // namespace
}  // namespace shearbus::testing
