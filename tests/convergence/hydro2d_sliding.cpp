// Sliding with friction in the two-dimensional hydrocode with its slide line, against exact solutions. Each test prints
// its table.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/hydro2d.hpp"
#include "tests/support/hydro2d_plates.hpp"
#include "tests/support/hydro_laws.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)
using lagrange::Ledger;

constexpr double kFriction = 50e6;

// Two half-spaces with impedances Z and friction stress s: the jump is [V] = V0 - s (1/Z_soft + 1/Z_hard) until waves
// arrive from the edges of the mesh.
TEST(Hydro2dSliding, HalfSpacesWithConstantFriction) {
  std::printf(
      "two half-spaces, 50 MPa, 100 m/s: jump at the middle (exact 92.184 m/s)\n width/um   at 50 ns   at 100 ns\n");
  for (const double width : {40e-6, 20e-6}) {
    ConstantFrictionLaw law(kFriction);
    Plates p;
    p.width = width;
    p.length = 2e-3;
    Cycle cycle(plates(p), &law);
    double at[2];
    for (int k : {0, 1}) {
      cycle.run_to(50e-9 * (k + 1));
      const auto answers = compare(p, cycle, kFriction);
      ASSERT_EQ(answers.back().what, "velocity jump");
      EXPECT_NEAR(answers.back().exact, 92.184, 5e-4);
      at[k] = answers.back().found;
    }
    std::printf("  %4.0f     %.4f    %.4f\n", width * 1e6, at[0], at[1]);
    EXPECT_NEAR(at[0], 92.184, width < 30e-6 ? 0.15 : 0.7);
    EXPECT_NEAR(at[1], 92.184, 0.15);
  }
}

// A plate of impedance Z rubs at one face, with friction stress s; its back is free. At every return of the wave from
// the back the velocity of the rubbing face falls by 2 s/Z.
TEST(Hydro2dSliding, FinitePlateWithFreeBack) {
  std::printf("plate of 0.5 mm with a free back: velocity of its face\n");
  Plates p;
  p.soft_depth = 0.5e-3;
  p.hard_depth = 1.0e-3;
  p.length = 6e-3;
  p.width = 50e-6;
  ConstantFrictionLaw law(kFriction);
  Cycle cycle(plates(p), &law);
  const double round_trip = 2.0 * p.soft_depth * 2703.0 / hydro::shear_impedance(p.soft.strength);
  for (const auto& [returns, exact] : {std::pair{0, 94.211}, std::pair{1, 82.633}}) {
    cycle.run_to((returns + 0.5) * round_trip);
    const hydro::Comparison face = compare(p, cycle, kFriction).front();
    std::printf(" after %d returns %.4f (exact %.4f)\n", returns, face.found, face.exact);
    EXPECT_NEAR(face.exact, exact, 1e-3);
    EXPECT_NEAR(face.found, exact, 0.25);
  }
}

// Two free plates slide with friction: their momentum does not change, and the lost kinetic energy becomes friction
// heat and elastic energy.
TEST(Hydro2dSliding, TwoFreePlatesKeepMomentumAndAccountForTheirEnergy) {
  Plates p;
  p.length = 2e-3;
  p.width = 50e-6;
  ConstantFrictionLaw law(kFriction);
  Cycle cycle(plates(p), &law);
  const Ledger start = cycle.ledger();
  cycle.run_to(1e-6);
  const Ledger end = cycle.ledger();
  std::printf(
      "two free plates: kinetic %.6g -> %.6g J/m, internal +%.6g (friction %.6g, closing %.2g), work of the pressure "
      "%.4g\n",
      start.kinetic, end.kinetic, end.internal - start.internal, end.friction_heat, end.closing_heat, end.work_given);
  EXPECT_NEAR((end.total_energy() - end.work_given) / start.total_energy(), 1.0, 1e-13);
  EXPECT_NEAR((end.momentum.x - end.impulse_given.x) / start.momentum.x, 1.0, 1e-12);
  EXPECT_NEAR((end.momentum.y - end.impulse_given.y) / start.momentum.x, 0.0, 1e-12);
  // the rest of the lost kinetic energy is elastic energy
  EXPECT_GT(end.friction_heat, 0.9 * (start.kinetic - end.kinetic));
  EXPECT_LT(end.friction_heat, kFriction * p.length * 100.0 * 1e-6);
  EXPECT_LT(std::abs(end.closing_heat), 1e-3 * end.friction_heat);
}

TEST(Hydro2dSliding, ALineTurnedByAnyAngleSlidesTheSame) {
  Plates p;
  p.length = 1e-3;
  p.width = 50e-6;
  ConstantFrictionLaw law(kFriction);
  Cycle straight(plates(p), &law);
  straight.run_to(2e-7);
  double worst = 0.0;
  for (const double angle : {0.2, 0.5 * std::numbers::pi, 2.5, -1.0}) {
    p.angle = angle;
    Cycle turned(plates(p), &law);
    turned.run_to(2e-7);
    ASSERT_EQ(turned.steps(), straight.steps());
    const Vec2 e = {std::cos(angle), std::sin(angle)};
    for (int n = 0; n < straight.mesh().num_nodes(); ++n) {
      const Vec2 v = turned.state().velocity[n];
      worst = std::max(worst, norm(Vec2{dot(v, e), cross(e, v)} - straight.state().velocity[n]));
    }
  }
  std::printf("turned lines: largest difference of a velocity %.1e m/s\n", worst);
  EXPECT_LT(worst, 1e-6);
}

// At 1000 m/s the middle of the slide line slips over more than two zones before waves arrive from the ends of the
// line. A line without friction must not lock, so the velocity jump must not fall.
TEST(Hydro2dSliding, AnObliqueLineWithoutFrictionDoesNotLock) {
  Plates p;
  p.length = 2e-3;
  p.width = 40e-6;
  p.angle = 0.35;
  p.jump = 1000.0;
  Cycle cycle(plates(p));
  cycle.run_to(1e-7);
  const int middle = cycle.contact().size() / 2;
  std::printf("oblique line, free slip over %.1f zones: jump 1000 -> %.7f m/s, pressure 1 -> %.6f GPa\n",
              p.jump * 1e-7 / p.width, cycle.contact().inputs().velocity_jump[middle],
              cycle.contact().inputs().pressure[middle] * 1e-9);
  EXPECT_NEAR(cycle.contact().inputs().velocity_jump[middle], 1000.0, 1e-3);
  EXPECT_NEAR(cycle.contact().inputs().pressure[middle] / p.pressure, 1.0, 1e-3);
}

}  // namespace
}  // namespace shearbus
