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
