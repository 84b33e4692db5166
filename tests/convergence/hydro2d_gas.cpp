// The two-dimensional hydrocode against exact solutions for gases: strong shocks, converging shocks, blast waves, and a
// piston on a skewed mesh. Each test prints its table.
#include <gtest/gtest.h>

#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

TEST(Hydro2dGas, Noh) {
  std::printf(
      "Noh, t = 0.6\nsymmetry zones  steps   mean density (exact)  shock at (0.2)  L1 of density  ratio  energy "
      "residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    const bool plane = symmetry == Symmetry::kPlane;
    double last = 0.0;
    for (const int zones : {20, 40}) {
      const hydro::NohProblem problem{symmetry, zones};
      Cycle cycle(make_bodies(problem));
      const lagrange::Ledger start = cycle.ledger();
      cycle.run_to(0.6);
      const std::vector<hydro::Comparison> answers = compare(problem, cycle);
      const double density = found(answers, "mean density behind the shock"),
                   front = found(answers, "radius of the shock"), error = found(answers, "mean error of the density"),
                   residual = energy_residual(start, cycle.ledger());
      std::printf("%s    %4d  %5d   %8.3f (%2.0f)         %.4f          %.4f         %.3f  %.1e\n",
                  plane ? "plane" : "axial", zones, static_cast<int>(cycle.steps()), density, answers[0].exact, front,
                  error, last > 0.0 ? error / last : 0.0, residual);
      EXPECT_LT(std::abs(residual), 1e-12);
      if (last > 0.0) {
        EXPECT_LT(error / last, 0.65);  // first order: half the zone width gives about half the error
        EXPECT_LT(error, plane ? 0.12 : 0.18);
        EXPECT_NEAR(front, 0.2, 0.015);
        EXPECT_NEAR(density / answers[0].exact, 1.0, plane ? 0.09 : 0.17);
      }
      last = error;
    }
  }
}

TEST(Hydro2dGas, Sedov) {
  std::printf(
      "Sedov, t = 1\nsymmetry zones  steps   shock at (1)  peak density (6)  spread of the front  energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    for (const int zones : {24, 48}) {
      const hydro::SedovProblem problem{symmetry, zones};
      Cycle cycle(make_bodies(problem));
      const lagrange::Ledger start = cycle.ledger();
      cycle.run_to(1.0);
      const std::vector<hydro::Comparison> answers = compare(problem, cycle);
      const double shock = found(answers, "radius of the shock"), peak = found(answers, "largest density"),
                   spread = found(answers, "spread of the front"), residual = energy_residual(start, cycle.ledger());
      std::printf("%s    %4d  %5d   %.4f        %.3f             %.4f               %.1e\n",
                  symmetry == Symmetry::kPlane ? "plane" : "axial", zones, static_cast<int>(cycle.steps()), shock, peak,
                  spread, residual);
      EXPECT_LT(std::abs(residual), 1e-12);
      if (zones == 48) {
        EXPECT_NEAR(shock, 1.0, 0.015);
        EXPECT_LT(spread, 0.025);  // spread of the shock radius, relative to the exact radius; a zone is 1/48
        EXPECT_GT(peak, 5.0);
        EXPECT_LT(peak, 6.3);
      }
    }
  }
}

TEST(Hydro2dGas, Saltzman) {
  std::printf(
      "Saltzman, t = 0.7\n zones      steps  mean density (4)  L1 of density  ratio  largest cross velocity  energy "
      "residual\n");
  double last = 0.0;
  for (const int zones : {10, 20}) {
    const hydro::SaltzmanProblem problem{zones};
    Cycle cycle(make_bodies(problem));
    const lagrange::Ledger start = cycle.ledger();
    cycle.run_to(0.7);
    const std::vector<hydro::Comparison> answers = compare(problem, cycle);
    const double density = found(answers, "mean density behind the shock"),
                 error = found(answers, "mean error of the density"),
                 crossing = found(answers, "largest cross velocity"), residual = energy_residual(start, cycle.ledger());
    std::printf(" %3d x %2d  %5d    %.4f          %.4f         %.3f   %.4f            %.1e\n", 10 * zones, zones,
                static_cast<int>(cycle.steps()), density, error, last > 0.0 ? error / last : 0.0, crossing, residual);
    EXPECT_LT(std::abs(residual), 1e-12);
    EXPECT_NEAR(density, 4.0, 0.04);
    if (last > 0.0) {
      EXPECT_LT(error / last, 0.65);
      EXPECT_LT(error, 0.04);
      EXPECT_LT(crossing, 0.08);
    }
    last = error;
  }
}

}  // namespace
}  // namespace shearbus
