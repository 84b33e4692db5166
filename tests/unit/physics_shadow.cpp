// A sample of nodes solved in full beside those that keep no profile (server/physics/MODEL.md section 3b): what the
// difference is told to be is what it is. Beside sleep: physics_sleep.cpp.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

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

ModelOptions shadowed(ModelOptions options) {
  options.shadow_share = 0.5;
  return options;
}

// Lanes whose bodies rub, stop and turn; every third opens for a while.
void fill(TileInputs& in, const TileOutputs& last, int n) {
  for (int l = 0; l < kLanes; ++l) {
    in.velocity_jump[l] = n % 90 == 0 ? (l % 2 == 0 ? 40.0 : -25.0) + 7.0 * l : last.velocity_jump_new[l];
    in.pressure[l] = l % 3 == 0 && n % 60 > 40 ? -1.0 : 6e9 + 5e8 * l;
    in.mass_minus[l] = in.mass_plus[l] = 0.2;
    in.stress_minus[l] = in.stress_plus[l] = n % 50 < 25 ? 120e6 : -90e6;
  }
}

void draw(Rig& rig, std::uint32_t lanes) {
  for (int l = 0; l < kLanes; ++l) rig.committed[rig.model.layout().shadowed + l] = lanes >> l & 1u ? 1.0 : 0.0;
}

class Shadow : public ::testing::TestWithParam<TimeIntegrator> {};

// In every step, whatever the node does, the shadow is the model with a profile under the same inputs, and what is
// told the distance to it; who is not drawn has none, and nobody's answer is touched.
TEST_P(Shadow, IsTheModelWithAProfile) {
  constexpr std::uint32_t kDrawn = 0b01101101;
  Rig rig(shadowed(without_profile(GetParam()))), alone(without_profile(GetParam()));
  Rig solved(with_profile(without_profile(GetParam())), kDrawn);
  draw(rig, kDrawn);
  const TileLayout& layout = rig.model.layout();
  double apart = 0.0;
  for (int n = 0; n < 250; ++n) {
    fill(rig.inputs, rig.outputs, n);
    rig.inputs.active = n % 7 == 3 ? 0b11110000 : 0xff;  // a batch of some of them
    alone.inputs = solved.inputs = rig.inputs;
    solved.inputs.active &= kDrawn;
    std::fill_n(rig.outputs.shadow_temperature_error, kLanes, -1.0);
    for (Rig* each : {&rig, &alone, &solved}) each->step(n % 3 == 0 ? 2e-9 : 1e-9);
    for (int l = 0; l < kLanes; ++l) {
      for (std::size_t i = static_cast<std::size_t>(l); i < alone.committed.size(); i += kLanes)
        ASSERT_EQ(rig.committed[i], alone.committed[i]) << n;
      if (!(solved.inputs.active >> l & 1u)) {
        ASSERT_EQ(rig.outputs.shadow_temperature_error[l], -1.0);
      } else {
        const double found = rig.outputs.shadow_temperature_error[l];
        ASSERT_EQ(found, std::abs(solved.outputs.interface_temperature[l] - rig.outputs.interface_temperature[l]));
        ASSERT_EQ(rig.outputs.shadow_stress_error[l],
                  std::abs(solved.outputs.shear_stress[l] - rig.outputs.shear_stress[l]));
        apart = std::max(apart, found);
      }
      for (std::size_t i = static_cast<std::size_t>(l); i < solved.committed.size(); i += kLanes)
        ASSERT_EQ(rig.committed[layout.shadow + i], solved.committed[i]) << "step " << n << ", row " << i / kLanes;
    }
  }
  EXPECT_GT(apart, 1e-3);
}

// Under a constant flux T0 is known. Of the distance told, what is the profile's own error is as large as section 3
// says of its method, and the rest, the modes', is below their accuracy.
TEST_P(Shadow, UnderConstantFluxItsDistanceIsTheProfilesOwnError) {
  Rig rig(shadowed(without_profile(GetParam())));
  draw(rig, 1);
  const ModelOptions& o = rig.model.options();
  rig.set_all(100.0, 1e8);  // mu P, and bodies that nothing stops
  rig.inputs.mass_minus[0] = rig.inputs.mass_plus[0] = 1e12;
  const double flux = rig.conducted_share() * 0.3e8 * 100.0;
  for (int n = 1; n <= 400; ++n) {
    rig.step(1e-9);
    const double t = 1e-9 * n;
    const double rise = 2.0 * flux / o.soft.conductivity * std::sqrt(o.soft.diffusivity * t / std::numbers::pi);
    ASSERT_NEAR(rig.outputs.interface_temperature[0] - 300.0, rise, 2e-6 * rise);
    const double found = rig.outputs.shadow_temperature_error[0] / rise;
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
INSTANTIATE_TEST_SUITE_P(Integrators, Shadow,
                         ::testing::Values(TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2),
                         [](const auto& param) {
                           return param.param == TimeIntegrator::kSdirk2 ? "Sdirk2" : "BackwardEuler";
                         });

// Modes that forget heat the run still feels are off by far more than they say, and the shadow says so.
TEST(PhysicsShadow, ModesThatForgetTooEarlyAreSeen) {
  double apart[2];
  for (const bool forgets : {false, true}) {
    ModelOptions options = shadowed(without_profile(TimeIntegrator::kSdirk2));
    if (forgets) options.modes->longest_time = 2e-9;
    Rig rig(options);
    draw(rig, 0xff);
    apart[forgets] = 0.0;
    for (int n = 0; n < 600; ++n) {
      rig.set_all(60.0, 8e9);
      rig.step(1e-9);
      apart[forgets] = std::max(apart[forgets], rig.outputs.shadow_temperature_error[0]);
    }
  }
  EXPECT_LT(apart[0], 5.0);  // [K], of the 900 to melting
  EXPECT_GT(apart[1], 20.0 * apart[0]);
}

// With a tolerance the server chooses modes and, for the shadow, cells: both deliver what was asked for.
TEST(PhysicsShadow, UnderAToleranceBothAreWithinIt) {
  constexpr double kTolerance = 1e-3;
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  Rig rig(shadowed(discretised(options, kTolerance)));
  ASSERT_TRUE(rig.model.options().modes.has_value());
  draw(rig, 0xff);
  double apart = 0.0;
  for (int n = 0; n < 150; ++n) {
    fill(rig.inputs, rig.outputs, n);
    rig.step(1e-9);
    for (int l = 0; l < kLanes; ++l) apart = std::max(apart, rig.outputs.shadow_temperature_error[l]);
  }
  EXPECT_GT(apart, 0.0);
  EXPECT_LT(apart, 2.0 * kTolerance * (options.soft.melting_temperature - 300.0));
}

}  // namespace
}  // namespace shearbus::testing
