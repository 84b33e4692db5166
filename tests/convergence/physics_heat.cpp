// Compares heat conduction, DLP (20-23), with exact solutions for a constant flux at z = 0.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kFlux = 1e10;    // heat flux at z = 0  [W/m2]
constexpr double kStart = 300.0;  // initial temperature  [K]

// Integral of the complementary error function from x to infinity, ierfc(x).
double ierfc(double x) {
  return std::exp(-x * x) / std::sqrt(M_PI) - x * std::erfc(x);
}

double half_space_rise(const Material& m, double t) {
  return 2.0 * kFlux / m.conductivity * std::sqrt(m.diffusivity * t / M_PI);
}

// Temperature rise at z = 0 of a slab with an insulated far face: the rise of a half-space plus that of image sources.
double slab_rise(const Material& m, double h, double t) {
  const double depth = std::sqrt(m.diffusivity * t);
  double sum = ierfc(0.0);
  for (int i = 1; i < 200; ++i) sum += 2.0 * ierfc(i * h / depth);
  return 2.0 * kFlux * depth / m.conductivity * sum;
}

// Temperature rise at z = 0 of a half-space under the flux q = kFlux, with backward Euler in time, exact in space: q
// sqrt(alpha dt)/k times the sum of binom(2j, j)/4^j over the steps j = 0, 1, ...
double half_space_rise_backward_euler(const Material& m, double dt, int steps) {
  double sum = 0.0, term = 1.0;
  for (int j = 0; j < steps; ++j) {
    sum += term;
    term *= (2.0 * j + 1.0) / (2.0 * j + 2.0);
  }
  return kFlux * std::sqrt(m.diffusivity * dt) / m.conductivity * sum;
}

// Temperatures after steps of conduction under the flux q = kFlux at z = 0.
std::vector<double> under_flux(const HeatGrid& grid, const HeatOperator& heat, int steps) {
  std::vector<double> T(static_cast<std::size_t>(grid.num_vertices()) * kLanes, kStart);
  double flux[kLanes];
  for (double& q : flux) q = kFlux;
  for (int n = 0; n < steps; ++n) {
    conduct(heat, grid.num_vertices(), T.data(), T.data());
    add_flux(heat, grid.num_vertices(), flux, T.data());
  }
  return T;
}

double computed_rise(const Material& m, const GridOptions& options, double dt, int steps) {
  const HeatGrid grid(Grid(options), options.far_boundary);
  return under_flux(grid, HeatOperator(grid, m, dt), steps)[0] - kStart;
}

TEST(PhysicsHeatConvergence, FirstOrderInTimeAgainstTheHalfSpace) {
  const Material m = paper_options().soft;
  const double t = 100e-9;
  Orders orders("constant flux into a half-space, t = 100 ns, 4000 cells: T0", 1.0, 0.02);
  for (int steps : {25, 50, 100, 200}) {
    const double rise = computed_rise(m, {20e-6, 4000, 1.0, FarBoundary::kInsulated}, t / steps, steps);
    const double error = rise / half_space_rise(m, t) - 1.0;
    EXPECT_NEAR(8 * steps * error, -1.0, 0.03);  // after n steps the rise is too low by a share of 1/(8n)
    orders.add(t / steps, error);
  }
}

// Two half-spaces in contact share the heat flux in proportion to their effusivities k/sqrt(alpha). Here the grids of
// the two bodies are chosen independently.
TEST(PhysicsHeatConvergence, FirstOrderInTimeWhereBothBodiesConduct) {
  const Material soft = paper_options().soft, hard = paper_options().hard;
  const double t = 100e-9;
  const double uptake =
      soft.conductivity / std::sqrt(soft.diffusivity) + hard.conductivity / std::sqrt(hard.diffusivity);
  const double exact = 2.0 * kFlux / uptake * std::sqrt(t / M_PI);
  const HeatGrid grid(Grid(GridOptions{20e-6, 4000, 1.0, FarBoundary::kInsulated}), FarBoundary::kInsulated,
                      Grid(GridOptions{12e-6, 1500, 1.001, FarBoundary::kInsulated}), FarBoundary::kInsulated);
  Orders orders("constant flux between two half-spaces, t = 100 ns: T0", 1.0, 0.02);
  for (int steps : {25, 50, 100, 200}) {
    const auto T = under_flux(grid, HeatOperator(grid, soft, hard, t / steps), steps);
    const double error = (T[static_cast<std::size_t>(grid.interface) * kLanes] - kStart) / exact - 1.0;
    EXPECT_NEAR(8 * steps * error, -1.0, 0.03);
    orders.add(t / steps, error);
  }
}

TEST(PhysicsHeatConvergence, SecondOrderInSpace) {
  const Material m = paper_options().soft;
  const double exact = half_space_rise_backward_euler(m, 1e-9, 100);
  Orders orders("constant flux, 100 steps of 1 ns, against backward Euler exact in space, cells: T0", 2.0, 0.1);
  for (int cells : {100, 200, 400, 800}) {
    orders.add(cells, computed_rise(m, {20e-6, cells, 1.0, FarBoundary::kInsulated}, 1e-9, 100) / exact - 1.0);
  }
  EXPECT_LT(std::abs(orders.last()), 5e-5);
}

TEST(PhysicsHeatConvergence, InsulatedSlabMatchesTheImageSeries) {
  const Material m = paper_options().soft;
  const double t = 3e-6;  // a time at which the heat has just reached the far face
  EXPECT_GT(slab_rise(m, 20e-6, t) / half_space_rise(m, t), 1.01);
  Orders orders("constant flux into an insulated slab of 20 um, 3 us, 2000 cells, steps: T0", 1.0, 0.1);
  for (int steps : {25, 50, 100, 200}) {
    const double rise = computed_rise(m, {20e-6, 2000, 1.0, FarBoundary::kInsulated}, t / steps, steps);
    orders.add(steps, rise / slab_rise(m, 20e-6, t) - 1.0);
  }
  EXPECT_LT(std::abs(orders.last()), 1e-3);
  // At 12 us the whole slab heats evenly, and the error of the first steps has decayed.
  EXPECT_NEAR(computed_rise(m, {20e-6, 500, 1.0, FarBoundary::kInsulated}, 12e-9, 1000) / slab_rise(m, 20e-6, 12e-6),
              1.0, 1e-6);
}

// Temperature rise at z = 0 of a slab whose far face keeps its temperature.
double held_slab_rise(const Material& m, double h, double t) {
  double sum = 0.0;
  for (int n = 1; n < 400; n += 2) {
    const double rate = m.diffusivity * std::pow(n * M_PI / (2.0 * h), 2);
    sum += std::exp(-rate * t) / (n * n);
  }
  return kFlux * h / m.conductivity * (1.0 - 8.0 / (M_PI * M_PI) * sum);
}

TEST(PhysicsHeatConvergence, SlabWithAHeldFaceMatchesItsSeries) {
  const Material m = paper_options().soft;
  const double h = 20e-6;
  const auto slab = [&](int cells) { return GridOptions{h, cells, 1.0, FarBoundary::kIsothermal}; };
  for (const double t : {3e-6, 10e-6}) {
    EXPECT_LT(held_slab_rise(m, h, t) / half_space_rise(m, t), 0.99);
    Orders orders("constant flux into a slab of 20 um with a held face, 2000 cells, steps: T0", 1.0, 0.1);
    for (int steps : {100, 200, 400})
      orders.add(steps, computed_rise(m, slab(2000), t / steps, steps) / held_slab_rise(m, h, t) - 1.0);
  }
  Orders orders("the same, 3 us in 50 steps, against 1600 cells, cells: T0", 2.0, 0.1);
  const double fine = computed_rise(m, slab(1600), 60e-9, 50);
  for (int cells : {25, 50, 100, 200}) orders.add(cells, computed_rise(m, slab(cells), 60e-9, 50) / fine - 1.0);
  EXPECT_NEAR(computed_rise(m, {h, 40, 1.1, FarBoundary::kIsothermal}, 1e-5, 100), kFlux * h / m.conductivity, 1e-6);
}

TEST(PhysicsHeatConvergence, GradedGridDoesWithATenthOfTheCells) {
  const Material m = paper_options().soft;
  for (double t : {10e-9, 100e-9, 1e-6}) {
    const int steps = static_cast<int>(std::lround(t / 1e-9));
    const double fine = computed_rise(m, {20e-6, 1000, 1.0, FarBoundary::kInsulated}, 1e-9, steps);
    const double graded = computed_rise(m, {20e-6, 60, 1.08, FarBoundary::kInsulated}, 1e-9, steps);
    EXPECT_NEAR(graded / fine, 1.0, 1e-3) << t;
  }
}

// A half-space is represented by a few wide cells behind z = h. The test prints the error of T0 when the heat is 1, 3,
// 10 and 50 h deep.
TEST(PhysicsHeatConvergence, HalfSpaceBehindTheLayerIsWithinAThousandth) {
  const Material m = paper_options().soft;
  const int steps = 2000;
  std::printf(
      "half-space behind a layer of 20 um: heat depth / h, T0 error of 500 uniform cells, of 60 graded, of an "
      "insulated face\n");
  for (double depth : {1.0, 3.0, 10.0, 50.0}) {
    const double t = std::pow(depth * 20e-6, 2) / m.diffusivity;
    const double exact = half_space_rise_backward_euler(m, t / steps, steps);
    const double uniform = computed_rise(m, {20e-6, 500, 1.0, FarBoundary::kHalfSpace}, t / steps, steps) / exact - 1.0;
    const double graded = computed_rise(m, {20e-6, 60, 1.08, FarBoundary::kHalfSpace}, t / steps, steps) / exact - 1.0;
    const double insulated = slab_rise(m, 20e-6, t) / half_space_rise(m, t) - 1.0;
    std::printf("  %4.0f  %10.2e  %10.2e  %10.2e\n", depth, uniform, graded, insulated);
    EXPECT_LT(std::abs(uniform), 1e-4) << depth;
    EXPECT_LT(std::abs(graded), 8e-4) << depth;
  }
}

}  // namespace
}  // namespace shearbus::testing
