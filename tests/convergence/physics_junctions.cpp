// Junctions between two rigid bodies under constant forces. With linear hardening and without softening the velocity
// jump [V] and the strain of the junctions ep are those of an oscillator, as long as the interface slips:
//   d[V]/dt = A - m K (1 + beta ep),  dep/dt = [V] / (sqrt(3) d),  K = f Y0 g / sqrt(3)
// A: acceleration of the jump by the far stresses, m: sum of the inverse masses, f and d: contact fraction and height
// of the junctions, Y0 and beta: yield strength and hardening coefficient of the junctions, g: pressure factor of the
// strength.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kJump = 100.0;  // initial velocity jump [m/s]
constexpr double kMass = 0.03;   // mass per area of each body [kg/m2]
constexpr double kEnd = 5e-9;    // end of the run [s]

struct Found {
  double jump, stress, strain, T0;
};

Found slide(const ModelOptions& options, double pull, int steps) {
  Rig rig(options, 1);
  double jump = kJump;
  for (int n = 0; n < steps; ++n) {
    rig.set_all(jump, 11.2e9);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = kMass;
    rig.inputs.stress_soft[0] = pull;
    rig.step(kEnd / steps);
    jump = rig.outputs.velocity_jump_new[0];
  }
  return {jump, rig.stress(), rig.junction_strain(), rig.T(0)};
}

ModelOptions junctions() {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven));
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.junctions = {0.4, 1e-6, options.soft};
  options.junctions->metal.yield_strength = 200e6;
  options.junctions->metal.hardening_coefficient = 5.0;
  options.junctions->metal.hardening_exponent = 1.0;
  return options;
}

TEST(PhysicsJunctionConvergence, LinearHardeningOscillates) {
  ModelOptions options = junctions();
  options.soft.temperature_coefficient = 0.0;
  options.soft.melting_temperature = 1e9;
  const double K = 0.4 * 200e6 / kSqrt3 * softening(options.soft, 11.2e9, 300.0).g;
  const double m = 2.0 / kMass, pull = 0.25 * K, A = pull / kMass;
  const double omega = std::sqrt(m * K * 5.0 / (kSqrt3 * 1e-6));
  const double c = std::cos(omega * kEnd), s = std::sin(omega * kEnd);
  const double jump = kJump * c + (A - m * K) / omega * s;
  const double strain = (kJump * s / omega + (A - m * K) / (omega * omega) * (1.0 - c)) / (kSqrt3 * 1e-6);
  ASSERT_GT(jump, 10.0);  // the interface still slips at the end of the run [m/s]
  Orders jumps("oscillator, [V]", 1.0, 0.07), strains("oscillator, ep_a", 1.0, 0.07),
      stresses("oscillator, s", 1.0, 0.07);
  for (const int steps : {64, 128, 256}) {
    const Found found = slide(options, pull, steps);
    jumps.add(steps, std::abs(found.jump / jump - 1.0));
    strains.add(steps, std::abs(found.strain / strain - 1.0));
    stresses.add(steps, std::abs(found.stress / (K * (1.0 + 5.0 * strain)) - 1.0));
  }
  for (const Orders* orders : {&jumps, &strains, &stresses}) EXPECT_LT(orders->last(), 5e-3);
}

// Junctions of the paper's aluminium, which hardens with strain and softens with temperature, under constant forces.
// Reference: a run with 16384 steps.
TEST(PhysicsJunctionConvergence, HardeningAndSofteningTogether) {
  const ModelOptions options = junctions();
  const Found exact = slide(options, 12e6, 16384);
  Orders jumps("with heat, [V]", 1.0, 0.07), rises("with heat, T0", 1.0, 0.07), stresses("with heat, s", 1.0, 0.07);
  for (const int steps : {64, 128, 256}) {
    const Found found = slide(options, 12e6, steps);
    jumps.add(steps, std::abs(found.jump / exact.jump - 1.0));
    rises.add(steps, std::abs((found.T0 - 300.0) / (exact.T0 - 300.0) - 1.0));
    stresses.add(steps, std::abs(found.stress / exact.stress - 1.0));
  }
  EXPECT_GT(exact.jump, 10.0);
  EXPECT_LT(jumps.last(), 5e-3);
  EXPECT_LT(rises.last(), 2e-2);
  EXPECT_LT(stresses.last(), 5e-3);
}

}  // namespace
}  // namespace shearbus::testing
