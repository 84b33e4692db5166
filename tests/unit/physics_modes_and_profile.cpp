// Models that keep the heat in modes, compared with models that keep a temperature profile under the same inputs
// (server/physics/METHODS.md, "Conduction").
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

ModelOptions without_profile(TimeIntegrator integrator = TimeIntegrator::kBackwardEuler) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), 120, 1.05);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.time_integrator = integrator;
  options.modes.emplace();
  return options;
}

ModelOptions with_profile(ModelOptions options) {
  options.modes.reset();
  return options;
}

// Sets the inputs of step n: the bodies slide, stop and reverse, and the contact of every third lane opens for a while.
void fill(TileInputs& in, const TileOutputs& last, int n) {
  for (int l = 0; l < kLanes; ++l) {
    in.velocity_jump[l] = n % 90 == 0 ? (l % 2 == 0 ? 40.0 : -25.0) + 7.0 * l : last.velocity_jump_new[l];
    in.pressure[l] = l % 3 == 0 && n % 60 > 40 ? -1.0 : 6e9 + 5e8 * l;
    in.mass_soft[l] = in.mass_hard[l] = 0.2;
    in.stress_soft[l] = in.stress_hard[l] = n % 50 < 25 ? 120e6 : -90e6;
  }
}

class ModesAndProfile : public ::testing::TestWithParam<TimeIntegrator> {};

// The exact interface temperature T0 under a constant flux is known, and modes reproduce it to their accuracy. The
// difference between modes and a temperature profile is therefore the error of the profile, which METHODS.md,
// "Conduction" gives for each scheme.
TEST_P(ModesAndProfile, UnderConstantFluxTheDistanceIsTheProfilesOwnError) {
  Rig rig(without_profile(GetParam())), profile(with_profile(without_profile(GetParam())));
  const ModelOptions& o = rig.model.options();
  rig.set_all(100.0, 1e8);  // the interface slips at mu P, and the heavy bodies keep their jump
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
  profile.inputs = rig.inputs;
  const double flux = rig.conducted_share() * 0.3e8 * 100.0;
  for (int n = 1; n <= 400; ++n) {
    rig.step(1e-9);
    profile.step(1e-9);
    const double t = 1e-9 * n;
    const double rise = 2.0 * flux / o.soft.conductivity * std::sqrt(o.soft.diffusivity * t / std::numbers::pi);
    const double T0 = rig.outputs.interface_temperature[0];
    ASSERT_NEAR(T0 - 300.0, rise, 2e-6 * rise);
    const double found = std::abs(profile.outputs.interface_temperature[0] - T0) / rise;
    if (GetParam() == TimeIntegrator::kBackwardEuler) {
      if (n == 1) {
        EXPECT_NEAR(found, 1.0 - 0.5 * std::sqrt(std::numbers::pi), 0.01);
      } else if (n >= 10) {
        ASSERT_NEAR(found, 1.0 / (8.0 * n), 2e-4 + 0.05 / n) << n;
      }
    } else {
      ASSERT_LT(found, 0.06 / (n * n) + 2e-4) << n;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Integrators, ModesAndProfile,
                         ::testing::Values(TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2),
                         [](const auto& param) {
                           return param.param == TimeIntegrator::kSdirk2 ? "Sdirk2" : "BackwardEuler";
                         });

// Modes whose `longest_time` is too short forget heat that still affects T0. Their difference from a temperature
// profile must then be far larger than with a sufficient `longest_time`.
TEST(PhysicsModesAndProfile, ModesThatForgetTooEarlyAreSeen) {
  double apart[2];
  for (const bool forgets : {false, true}) {
    ModelOptions options = without_profile(TimeIntegrator::kSdirk2);
    if (forgets) options.modes->longest_time = 2e-9;
    Rig rig(options), profile(with_profile(options));
    apart[forgets] = 0.0;
    for (int n = 0; n < 600; ++n) {
      for (Rig* each : {&rig, &profile}) {
        each->set_all(60.0, 8e9);
        each->step(1e-9);
      }
      apart[forgets] = std::max(
          apart[forgets], std::abs(profile.outputs.interface_temperature[0] - rig.outputs.interface_temperature[0]));
    }
  }
  // largest difference of T0 between modes and profile [K]; T0 itself rises by up to about 900 K
  EXPECT_LT(apart[0], 5.0);
  EXPECT_GT(apart[1], 20.0 * apart[0]);
}

// For this force-driven scene with a tolerance the server keeps the heat in modes. A model that keeps a temperature
// profile may differ by at most the errors that the tolerance allows each of the two.
TEST(PhysicsModesAndProfile, UnderAToleranceBothAreWithinIt) {
  constexpr double kTolerance = 1e-3;
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options = discretised(options, kTolerance);
  ASSERT_TRUE(options.modes.has_value());
  Rig rig(options), profile(with_profile(options));
  double apart = 0.0;
  for (int n = 0; n < 150; ++n) {
    fill(rig.inputs, rig.outputs, n);
    profile.inputs = rig.inputs;
    rig.step(1e-9);
    profile.step(1e-9);
    for (int l = 0; l < kLanes; ++l)
      apart =
          std::max(apart, std::abs(profile.outputs.interface_temperature[l] - rig.outputs.interface_temperature[l]));
  }
  EXPECT_GT(apart, 0.0);
  EXPECT_LT(apart, 2.0 * kTolerance * (options.soft.melting_temperature - 300.0));
}

}  // namespace
}  // namespace shearbus::testing
