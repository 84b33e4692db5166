// The melt film of a force-driven interface (server/physics/MODEL.md, "Melt film").
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 11.2e9;

ModelOptions melting_options(int cells = 40, double grading = 1.12) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), cells, grading);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options = two_sided(options);
  options.melt_film = MeltFilmOptions{.latent_heat = 397e3, .viscosity = 1.25e-3, .activation_energy = 16.5e3};
  return options;
}

// Steps an interface whose jump is imposed: the bodies are so heavy that no stress changes it.
void impose(Rig& rig, double jump, double pressure = kPressure) {
  rig.set_all(jump, pressure);
  for (int l = 0; l < kLanes; ++l) rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = 1e12;
}

// Until the interface melts the step is that of a solid contact whose strength does not fall near T_melt.
TEST(PhysicsMeltFilm, TheSolidContactKeepsItsStrengthUpToMelting) {
  Rig rig(melting_options());
  impose(rig, 100.0);
  double last = 0.0;
  for (int n = 0; n < 4000 && rig.film_thickness() == 0.0; ++n) {
    rig.step(1e-9);
    if (rig.film_thickness() > 0.0) break;
    const double bracket = 1.0 + 6.52e-11 * kPressure - 6.16e-4 * (rig.T(0) - 300.0);
    EXPECT_NEAR(rig.stress(), 200e6 / kSqrt3 * bracket, 1e-3);
    last = rig.T(0);
  }
  EXPECT_GT(last, 1215.0);
  EXPECT_GT(rig.film_thickness(), 0.0);
}

// A cold contact that holds what it is asked for sticks: the slip that rounding leaves of the stress that sticks is no
// other answer.
TEST(PhysicsMeltFilm, AColdContactThatHoldsSticks) {
  Draw draw(31);
  Rig rig(melting_options(12, 1.4));
  const std::vector<double> fresh = rig.committed;
  int stuck = 0;
  for (int n = 0; n < 4000; ++n) {
    rig.committed = fresh;
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.pressure[l] = 2e9;
      rig.inputs.velocity_jump[l] = draw.sign() * draw.log_uniform(1e-3, 10.0);
      rig.inputs.mass_soft[l] = draw.log_uniform(1e-3, 1.0);
      rig.inputs.mass_hard[l] = draw.log_uniform(1e-3, 1.0);
      rig.inputs.stress_soft[l] = draw.uniform(-8e7, 8e7);
      rig.inputs.stress_hard[l] = draw.uniform(-8e7, 8e7);
    }
    rig.step(1e-9);
    for (int l = 0; l < kLanes; ++l) {
      const double driven = 1e-9 * (rig.inputs.stress_soft[l] / rig.inputs.mass_soft[l] +
                                    rig.inputs.stress_hard[l] / rig.inputs.mass_hard[l]);
      const double size = std::abs(rig.inputs.velocity_jump[l]) + std::abs(driven);
      if (std::abs(rig.outputs.velocity_jump_new[l]) > 1e-13 * size) continue;
      ++stuck;
      ASSERT_EQ(rig.outputs.regime[l], Regime::kStick) << n << ", " << l;
      ASSERT_EQ(rig.outputs.outcome[l], 0) << n << ", " << l;
    }
  }
  EXPECT_GT(stuck, 5000);
}

}  // namespace
}  // namespace shearbus::testing
