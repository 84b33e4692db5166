// What a velocity-driven host applies: the impulse of the mean stress of each step against that of the stress at its
// end, with their orders.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

struct Impulse {
  double of_end = 0.0, of_mean = 0.0;  // sum of stress at the end, and of mean stress, times dt  [Pa s]
};

Impulse run(const ModelOptions& options, double end, int steps, double jump) {
  Rig rig(options, 1);
  rig.inputs.wants_mean_stress = true;
  rig.set_all(jump, 11.2e9);
  Impulse sum;
  for (int n = 0; n < steps; ++n) {
    rig.step(end / steps);
    sum.of_end += end / steps * rig.outputs.shear_stress[0];
    sum.of_mean += end / steps * rig.outputs.mean_shear_stress[0];
  }
  return sum;
}

// A layer that hardens without softening: its stress at the end of a step is exact for any dt, so only the impulse has
// an error.
TEST(PhysicsMeanStressConvergence, ImpulseOfAHardeningLayerIsOfSecondOrder) {
  ModelOptions options = graded(paper_options(), 8, 1.3);
  options.soft.temperature_coefficient = 0.0;
  options.soft.melting_temperature = 1e13;
  constexpr double kEnd = 1e-7;
  constexpr int kFine = 40000;
  const double exact = run(options, kEnd, kFine, 100.0).of_mean;
  Impulse last;
  for (const int steps : {400, 800, 1600, 3200}) {
    const Impulse found = run(options, kEnd, steps, 100.0);
    const Impulse error{found.of_end / exact - 1.0, found.of_mean / exact - 1.0};
    std::printf("%5d steps: error of the impulse %.2e by the end, %.2e by the mean\n", steps, error.of_end,
                error.of_mean);
    if (steps > 400) {
      EXPECT_NEAR(std::log2(last.of_end / error.of_end), 1.0, 0.05);
      EXPECT_GT(std::log2(last.of_mean / error.of_mean), 1.8);
    }
    last = error;
  }
  EXPECT_LT(std::abs(last.of_mean), 0.02 * std::abs(last.of_end));
}

// The paper's case: 1 us at 100 m/s under 11.2 GPa.
TEST(PhysicsMeanStressConvergence, ImpulseOfThePapersCase) {
  constexpr double kEnd = 1e-6;
  ModelOptions first = graded(paper_options());
  ModelOptions second = first;
  second.time_integrator = TimeIntegrator::kSdirk2;
  const double exact = run(second, kEnd, 10240, 100.0).of_mean;
  std::printf("impulse %.6f Pa s\n", exact);
  for (const int steps : {10, 20, 40, 80, 160}) {
    Impulse error[2];
    for (const int order : {0, 1}) {
      const Impulse found = run(order == 0 ? first : second, kEnd, steps, 100.0);
      error[order] = {found.of_end / exact - 1.0, found.of_mean / exact - 1.0};
    }
    std::printf("%4d steps: backward Euler %+.2e by the end, %+.2e by the mean; sdirk2 %+.2e, %+.2e\n", steps,
                error[0].of_end, error[0].of_mean, error[1].of_end, error[1].of_mean);
    // The error of T0, of first order, is left with backward Euler: it may cancel against that of the end.
    EXPECT_LT(std::abs(error[0].of_mean), 0.2 / steps);
    if (steps < 100) {
      EXPECT_LT(std::abs(error[1].of_mean), 0.5 * std::abs(error[1].of_end));
    }
  }
  const ModelOptions controlled = discretised(paper_options(), 1e-3);
  const double its_exact = run(controlled, kEnd, 2560, 100.0).of_mean;
  for (const int steps : {10, 100}) {
    const Impulse found = run(controlled, kEnd, steps, 100.0);
    std::printf("%4d steps, tolerance 1e-3: %+.2e by the end, %+.2e by the mean\n", steps,
                found.of_end / its_exact - 1.0, found.of_mean / its_exact - 1.0);
    EXPECT_LT(std::abs(found.of_mean / its_exact - 1.0), 2e-4);
    EXPECT_GT(std::abs(found.of_end / its_exact - 1.0), 5e-4);
  }
}

}  // namespace
}  // namespace shearbus::testing
