// The two-dimensional hydrocode with plastic flow at large strain: imploding shells that plastic work brings to rest,
// and Taylor's bar. Each test prints its table.
#include <gtest/gtest.h>

#include "hydro_stub/verification/exact.hpp"
#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

hydro::Metal beryllium() {
  return plastic_metal({.density = 1845.0, .sound_speed = 7998.0, .s1 = 1.124, .gamma0 = 1.11, .specific_heat = 1820.0},
                       151e9, 330e6);
}

// Runs the implosion until the shell is at rest, and compares the result with the exact solution.
std::vector<hydro::Comparison> stopped(const hydro::ImplosionProblem& problem, double& residual) {
  Cycle cycle(make_bodies(problem));
  const lagrange::Ledger start = cycle.ledger();
  while (!at_rest(problem, cycle)) cycle.advance(1.0);
  residual = energy_residual(start, cycle.ledger());
  return compare(problem, cycle);
}

// Published values: cylindrical shells with initial speeds of 417.08 and 454.65 m/s stop at inner radii of 50 and 45 mm
// (B. Verney; G. Howell & G. Ball, J. Comput. Phys. 175 (2002) 128).
TEST(Hydro2dMetals, ExactSpeedsOfImplodingCylindersAreThePublishedOnes) {
  EXPECT_NEAR(hydro::cylinder_speed(beryllium(), 80e-3, 100e-3, 50e-3), 417.08, 0.005);
  EXPECT_NEAR(hydro::cylinder_speed(beryllium(), 80e-3, 100e-3, 45e-3), 454.65, 0.005);
}

TEST(Hydro2dMetals, ImplodingCylinderStopsWherePlasticWorkHasTakenItsEnergy) {
  std::printf("imploding cylinder   zones  stops at/mm (exact)  energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kAxisymmetric, Symmetry::kPlane}) {
    for (const double stop : {50e-3, 45e-3}) {
      for (const int zones : {10, 20}) {
        double residual = 0.0;
        const double radius = found(stopped({.sphere = false,
                                             .symmetry = symmetry,
                                             .metal = beryllium(),
                                             .inner = 80e-3,
                                             .outer = 100e-3,
                                             .stop = stop,
                                             .zones = zones},
                                            residual),
                                    "inner radius at rest");
        std::printf(" %s              %3d    %.3f (%.0f)          %.1e\n",
                    symmetry == Symmetry::kPlane ? "plane" : "slice", zones, radius * 1e3, stop * 1e3, residual);
        EXPECT_NEAR(radius / stop, 1.0, zones == 20 ? 0.005 : 0.01);
        EXPECT_LT(std::abs(residual), 1e-12);
      }
    }
  }
}

TEST(Hydro2dMetals, ImplodingSphereStopsWherePlasticWorkHasTakenItsEnergy) {
  constexpr double kStop = 60e-3;
  std::printf("imploding sphere   zones   stops at/mm (60)  spread of the inner radius/mm  energy residual\n");
  for (const int zones : {8, 16}) {
    double residual = 0.0;
    const auto answers = stopped({.sphere = true,
                                  .symmetry = Symmetry::kAxisymmetric,
                                  .metal = beryllium(),
                                  .inner = 80e-3,
                                  .outer = 100e-3,
                                  .stop = kStop,
                                  .zones = zones},
                                 residual);
    const double radius = found(answers, "inner radius at rest"), spread = found(answers, "spread of the inner radius");
    std::printf("                   %3d       %.3f            %.3f                      %.1e\n", zones, radius * 1e3,
                spread * 1e3, residual);
    EXPECT_NEAR(radius / kStop, 1.0, zones == 16 ? 0.003 : 0.02);
    EXPECT_LT(spread, 0.03 * kStop);
    EXPECT_LT(std::abs(residual), 1e-12);
  }
}

TEST(Hydro2dMetals, TaylorBar) {
  std::printf("Taylor bar  zones     steps   length/mm  foot radius/mm  kinetic left  energy residual\n");
  for (const int across : {5, 10}) {
    hydro::TaylorProblem problem{
        .metal = plastic_metal(
            {.density = 8930.0, .sound_speed = 3940.0, .s1 = 1.489, .gamma0 = 2.02, .specific_heat = 385.0}, 43.33e9,
            400e6),
        .radius = 3.2e-3,
        .length = 32.4e-3,
        .speed = 227.0,
        .zones = across};
    problem.metal.strength.hardening_coefficient = 0.25;  // the exponent is 1, so hardening is linear
    Cycle cycle(make_bodies(problem));
    const lagrange::Ledger start = cycle.ledger();
    cycle.run_to(80e-6);
    const lagrange::Ledger end = cycle.ledger();
    const auto answers = compare(problem, cycle);
    const double length = found(answers, "length"), foot = found(answers, "radius of the foot");
    std::printf("          %3d         %6d   %.3f     %.3f          %.4f        %.1e\n", across,
                static_cast<int>(cycle.steps()), length * 1e3, foot * 1e3, end.kinetic / start.kinetic,
                energy_residual(start, end));
    EXPECT_LT(std::abs(energy_residual(start, end)), 1e-12);
    if (across == 10) {
      EXPECT_GT(length, 21.3e-3);
      EXPECT_LT(length, 21.8e-3);
      EXPECT_GT(foot, 6.9e-3);
      EXPECT_LT(foot, 7.3e-3);
    }
    EXPECT_LT(end.kinetic, 0.02 * start.kinetic);
  }
}

}  // namespace
}  // namespace shearbus
