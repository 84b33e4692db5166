// The exact solutions with which tests/integration/hydro_verification.py compares the two-dimensional hydrocode, against
// published values.
#include "hydro_stub/verification/exact.hpp"

#include <gtest/gtest.h>

#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

// The published solution assumes that the Grueneisen coefficient Gamma is constant. Our equation of state assumes that
// the product rho Gamma is constant. The results differ in the fifth digit.
TEST(Hydro2dExact, TwoWavesOfAPistonAreThePublishedOnes) {
  const hydro::Metal metal = plastic_metal(
      {.density = 2790.0, .sound_speed = 5330.0, .s1 = 1.34, .gamma0 = 2.0, .specific_heat = 900.0}, 28.6e9, 0.26e9);
  const hydro::TwoWaves exact = hydro::two_waves(metal, 100.0);
  EXPECT_NEAR(exact.elastic_stress / 0.537995e9, 1.0, 1e-5);
  EXPECT_NEAR(exact.elastic_speed / 6520.66, 1.0, 1e-5);
  EXPECT_NEAR(exact.plastic_speed / 5505.53, 1.0, 5e-5);
  EXPECT_NEAR(exact.stress / 1.618888e9, 1.0, 5e-5);
}

TEST(Hydro2dExact, ImpactsAreThePublishedOnes) {
  const hydro::Metal aluminium = plastic_metal(aluminium_6061(), 27.6e9, 200e6);
  const hydro::Metal steel = plastic_metal(steel_304(), 77e9, 340e6);
  const hydro::Impact same = hydro::impact(steel, steel, 600.0);
  EXPECT_NEAR(same.velocity, 300.0, 1e-6);
  EXPECT_NEAR(same.stress / 12.0111e9, 1.0, 1e-4);
  const hydro::Impact other = hydro::impact(steel, aluminium, 600.0);
  EXPECT_NEAR(other.velocity / 425.515, 1.0, 1e-4);
  EXPECT_NEAR(other.stress / 6.7814e9, 1.0, 1e-4);
}

// Published values: cylindrical shells with initial speeds of 417.08 and 454.65 m/s stop at inner radii of 50 and 45 mm
// (B. Verney; G. Howell & G. Ball, J. Comput. Phys. 175 (2002) 128).
TEST(Hydro2dExact, SpeedsOfImplodingCylindersAreThePublishedOnes) {
  const hydro::Metal beryllium = plastic_metal(
      {.density = 1845.0, .sound_speed = 7998.0, .s1 = 1.124, .gamma0 = 1.11, .specific_heat = 1820.0}, 151e9, 330e6);
  EXPECT_NEAR(hydro::cylinder_speed(beryllium, 80e-3, 100e-3, 50e-3), 417.08, 0.005);
  EXPECT_NEAR(hydro::cylinder_speed(beryllium, 80e-3, 100e-3, 45e-3), 454.65, 0.005);
}

}  // namespace
}  // namespace shearbus
