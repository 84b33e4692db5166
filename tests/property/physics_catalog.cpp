// Steps layers of every pair of materials in the catalog, each material as the soft and as the hard body, in both
// strategies.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr int kSteps = 50;
constexpr double kStep = 6e-9;  // step length [s]

ModelOptions pair_options(const CatalogEntry& soft, const CatalogEntry& hard, Strategy strategy) {
  ModelOptions options = graded(paper_options(strategy), 20, 1.25);
  options.soft = soft.material;
  options.hard = hard.material;
  options.interface.yield_strength = std::min(fresh_strength(soft.material), fresh_strength(hard.material));
  return options;
}

void expect_sound(const Rig& rig, int lane, double heat_in) {
  const TileOutputs& out = rig.outputs;
  const Material& soft = rig.model.options().soft;
  ASSERT_FALSE(out.outcome[lane] & kFailed);
  ASSERT_TRUE(std::isfinite(out.shear_stress[lane]) && std::isfinite(out.sliding_velocity[lane]));
  ASSERT_GE(out.shear_stress[lane] * out.sliding_velocity[lane], 0.0);
  ASSERT_LT(out.interface_temperature[lane], soft.melting_temperature);
  ASSERT_GE(out.interface_temperature[lane], rig.model.options().initial_temperature);
  ASSERT_NEAR(rig.stored_heat(rig.model.options().initial_temperature, lane), heat_in, 1e-9 * heat_in + 1e-6);
}

// Steps every pair of materials in the catalog. The lanes have velocity jumps of 1 to 1000 m/s in both directions and
// pressures of 1 to 32 GPa.
template <class Prepare, class Check>
void run_every_pair(Strategy strategy, const Prepare& prepare, const Check& check) {
  for (const CatalogEntry& soft : catalog()) {
    for (const CatalogEntry& hard : catalog()) {
      SCOPED_TRACE(std::string(soft.name) + " on " + std::string(hard.name));
      Rig rig(pair_options(soft, hard, strategy));
      double heat_in[kLanes] = {};
      for (int l = 0; l < kLanes; ++l) {
        rig.inputs.velocity_jump[l] = (l % 2 == 0 ? 1.0 : -1.0) * std::pow(10.0, 3.0 * l / (kLanes - 1));
        rig.inputs.pressure[l] = 1e9 * std::pow(10.0, 1.5 * (l * 5 % kLanes) / (kLanes - 1));
      }
      prepare(rig);
      for (int n = 0; n < kSteps; ++n) {
        rig.step(kStep);
        for (int l = 0; l < kLanes; ++l) {
          heat_in[l] += rig.outputs.friction_heat[l];
          expect_sound(rig, l, heat_in[l]);
          if (::testing::Test::HasFatalFailure()) return;
        }
        check(rig);
        if (::testing::Test::HasFatalFailure()) return;
      }
    }
  }
}

TEST(PhysicsCatalog, EveryPairShearsItsLayer) {
  int flowed = 0;
  run_every_pair(
      Strategy::kVelocityDriven, [](Rig&) {},
      [&](const Rig& rig) {
        const Material& soft = rig.model.options().soft;
        for (int l = 0; l < kLanes; ++l) {
          // Bounds of a velocity-driven layer without a friction limit: its plastic slip cannot exceed the imposed
          // slip, and its stress stays below 1.2 times the shear modulus G0.
          const double h = rig.model.options().grid.thickness;
          flowed += rig.outputs.sliding_velocity[l] != 0.0;
          ASSERT_LE(std::abs(rig.stress(l)), 1.2 * soft.shear_modulus * (1.0 + 1e-10));
          ASSERT_LE(rig.plastic_slip(l), std::abs(rig.inputs.velocity_jump[l]) * kSteps * kStep + h * 1e-9);
        }
      });
  EXPECT_GT(flowed, 10000);
}

TEST(PhysicsCatalog, EveryPairSlidesToItsOwnRest) {
  int stuck = 0, slid = 0;
  run_every_pair(
      Strategy::kForceDriven,
      [](Rig& rig) {
        for (int l = 0; l < kLanes; ++l) {
          rig.inputs.mass_soft[l] = rig.model.options().soft.density * 5e-6;
          rig.inputs.mass_hard[l] = rig.model.options().hard.density * 5e-6;
        }
      },
      [&](Rig& rig) {
        const InterfaceOptions& law = rig.model.options().interface;
        for (int l = 0; l < kLanes; ++l) {
          const double limit = std::min(law.friction_coefficient * rig.inputs.pressure[l], 3.0 * law.yield_strength);
          ASSERT_LE(std::abs(rig.stress(l)), limit * (1.0 + 1e-10));
          ASSERT_LE(std::abs(rig.outputs.velocity_jump_new[l]), std::abs(rig.inputs.velocity_jump[l]));
          rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
          (rig.outputs.regime[l] == Regime::kStick ? stuck : slid) += 1;
        }
      });
  EXPECT_GT(std::min(stuck, slid), 10000);
}

TEST(PhysicsCatalog, ASofterHardBodyIsToldOf) {
  const auto of = [](const char* soft, const char* hard) {
    ModelOptions options = paper_options();
    options.soft = make_material(soft, {}).material;
    options.hard = make_material(hard, {}).material;
    const auto warnings = Model(options).warnings();
    return std::any_of(warnings.begin(), warnings.end(), [](const std::string& warning) {
      return warning.find("yield strength") != std::string::npos && warning.find("hard body") != std::string::npos;
    });
  };
  EXPECT_TRUE(of("steel_4340_jc", "copper_ofhc"));
  EXPECT_FALSE(of("copper_ofhc", "steel_4340_jc"));
}

}  // namespace
}  // namespace shearbus::testing
