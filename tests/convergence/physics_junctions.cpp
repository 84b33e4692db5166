// Junctions between two rigid bodies under constant forces. With linear hardening and without softening the velocity
// jump [V] and the strain of the junctions ep are those of an oscillator, as long as the interface slips:
//   d[V]/dt = A - m K (1 + beta ep),  dep/dt = [V] / (sqrt(3) d),  K = f Y0 g / sqrt(3)
// A: acceleration of the jump by the far stresses, m: sum of the inverse masses, f and d: contact fraction and height
// of the junctions, Y0 and beta: yield strength and hardening coefficient of the junctions, g: pressure factor of the
// strength.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

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

void expect_first_order(const char* name, const double (&error)[3], double most) {
  std::printf("%-24s %.2e %.2e %.2e, ratios %.3f %.3f\n", name, error[0], error[1], error[2], error[0] / error[1],
              error[1] / error[2]);
  EXPECT_NEAR(error[0] / error[1], 2.0, 0.1) << name;
  EXPECT_NEAR(error[1] / error[2], 2.0, 0.1) << name;
  EXPECT_LT(error[2], most) << name;
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
  double error[3][3];
  for (int k = 0; k < 3; ++k) {
    const Found found = slide(options, pull, 64 << k);
    error[0][k] = std::abs(found.jump / jump - 1.0);
    error[1][k] = std::abs(found.strain / strain - 1.0);
    error[2][k] = std::abs(found.stress / (K * (1.0 + 5.0 * strain)) - 1.0);
  }
  expect_first_order("oscillator, [V]", error[0], 5e-3);
  expect_first_order("oscillator, ep_a", error[1], 5e-3);
  expect_first_order("oscillator, s", error[2], 5e-3);
}

// Junctions of the paper's aluminium, which hardens with strain and softens with temperature, under constant forces.
// Reference: a run with 16384 steps.
TEST(PhysicsJunctionConvergence, HardeningAndSofteningTogether) {
  const ModelOptions options = junctions();
  const Found exact = slide(options, 12e6, 16384);
  double error[3][3];
  for (int k = 0; k < 3; ++k) {
    const Found found = slide(options, 12e6, 64 << k);
    error[0][k] = std::abs(found.jump / exact.jump - 1.0);
    error[1][k] = std::abs((found.T0 - 300.0) / (exact.T0 - 300.0) - 1.0);
    error[2][k] = std::abs(found.stress / exact.stress - 1.0);
  }
  EXPECT_GT(exact.jump, 10.0);
  expect_first_order("with heat, [V]", error[0], 5e-3);
  expect_first_order("with heat, T0", error[1], 2e-2);
  expect_first_order("with heat, s", error[2], 5e-3);
}

}  // namespace
}  // namespace shearbus::testing
