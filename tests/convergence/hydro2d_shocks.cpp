// The two-dimensional hydrocode against exact shocks in metals. Each test prints its table.
#include <gtest/gtest.h>

#include "hydro_stub/verification/exact.hpp"
#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

hydro::Metal piston_metal() {
  return plastic_metal({.density = 2790.0, .sound_speed = 5330.0, .s1 = 1.34, .gamma0 = 2.0, .specific_heat = 900.0},
                       28.6e9, 0.26e9);
}
constexpr double kPistonSpeed = 100.0;

const char* name(Symmetry symmetry) {
  return symmetry == Symmetry::kPlane ? "plane" : "axial";
}

// The published solution assumes that the Grueneisen coefficient Gamma is constant. Our equation of state assumes that
// the product rho Gamma is constant. The results differ in the fifth digit.
TEST(Hydro2dShock, ExactTwoWavePistonIsThePublishedOne) {
  const hydro::TwoWaves exact = hydro::two_waves(piston_metal(), kPistonSpeed);
  EXPECT_NEAR(exact.elastic_stress / 0.537995e9, 1.0, 1e-5);
  EXPECT_NEAR(exact.elastic_speed / 6520.66, 1.0, 1e-5);
  EXPECT_NEAR(exact.plastic_speed / 5505.53, 1.0, 5e-5);
  EXPECT_NEAR(exact.stress / 1.618888e9, 1.0, 5e-5);
}

TEST(Hydro2dShock, ElasticPlasticPiston) {
  const hydro::TwoWaves exact = hydro::two_waves(piston_metal(), kPistonSpeed);
  std::printf("symmetry zones   L1 of stress  ratio   behind/GPa   elastic limit/GPa  energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    double last = 0.0;
    for (const int zones : {100, 200, 400}) {
      const hydro::PistonProblem problem{
          .symmetry = symmetry, .metal = piston_metal(), .length = 50e-3, .zones = zones, .speed = kPistonSpeed};
      Cycle cycle(make_bodies(problem));
      const lagrange::Ledger start = cycle.ledger();
      cycle.run_to(5e-6);
      const auto answers = compare(problem, cycle);
      const double error = found(answers, "mean error of the stress"),
                   behind = found(answers, "stress behind both waves"), limit = found(answers, "elastic limit"),
                   residual = energy_residual(start, cycle.ledger());
      std::printf("%s    %5d   %.6f      %.3f   %.6f     %.6f           %.1e\n", name(symmetry), zones, error,
                  last > 0.0 ? error / last : 0.0, behind * 1e-9, limit * 1e-9, residual);
      EXPECT_LT(std::abs(residual), 1e-13);
      if (last > 0.0) {
        EXPECT_LT(error / last, 0.6);  // first order in the zone width, because the fronts are discontinuities
      }
      if (zones == 400) {
        EXPECT_LT(error, 0.010);
        EXPECT_NEAR(behind / exact.stress, 1.0, 2e-4);
        EXPECT_NEAR(limit / exact.elastic_stress, 1.0, 2e-3);
      }
      last = error;
    }
  }
}

const hydro::Metal kAluminium = plastic_metal(aluminium_6061(), 27.6e9, 200e6);
const hydro::Metal kSteel = plastic_metal(steel_304(), 77e9, 340e6);

TEST(Hydro2dShock, ExactImpactsAreThePublishedOnes) {
  const hydro::Impact same = hydro::impact(kSteel, kSteel, 600.0);
  EXPECT_NEAR(same.velocity, 300.0, 1e-6);
  EXPECT_NEAR(same.stress / 12.0111e9, 1.0, 1e-4);
  const hydro::Impact other = hydro::impact(kSteel, kAluminium, 600.0);
  EXPECT_NEAR(other.velocity / 425.515, 1.0, 1e-4);
  EXPECT_NEAR(other.stress / 6.7814e9, 1.0, 1e-4);
}

// A flyer plate hits a target plate across a slide line.
TEST(Hydro2dShock, FlyersOnTargets) {
  std::printf("symmetry flyer on target   velocity (exact)      stress/GPa (exact)   energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    for (const hydro::Metal& target : {kAluminium, kSteel}) {
      const hydro::FlyerProblem problem{
          .symmetry = symmetry, .target = target, .flyer = kSteel, .length = 10e-3, .zones = 200, .speed = 600.0};
      Cycle cycle(make_bodies(problem));
      const lagrange::Ledger start = cycle.ledger();
      cycle.run_to(1.2e-6);
      const auto answers = compare(problem, cycle);
      const double residual = energy_residual(start, cycle.ledger());
      std::printf("%s    steel on %s %.3f (%.3f)     %.4f (%.4f)     %.1e\n", name(symmetry),
                  target.eos.density < 5000.0 ? "aluminium" : "steel    ", answers[0].found, answers[0].exact,
                  answers[1].found * 1e-9, answers[1].exact * 1e-9, residual);
      for (const hydro::Comparison& c : answers) EXPECT_NEAR(c.found / c.exact, 1.0, 2e-3) << c.what;
      EXPECT_LT(std::abs(residual), 1e-13);
    }
  }
}

}  // namespace
}  // namespace shearbus
