// The answer of a node depends on its own state and inputs only, to the last bit.
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstring>
#include <numeric>

#include "tests/support/random_physics.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::testing {
namespace {

void copy_inputs(const TileInputs& from, int i, TileInputs& to, int j) {
  to.velocity_jump[j] = from.velocity_jump[i];
  to.pressure[j] = from.pressure[i];
  to.soft_shear_rate[j] = from.soft_shear_rate[i];
  to.stress_soft[j] = from.stress_soft[i];
  to.stress_hard[j] = from.stress_hard[i];
  to.mass_soft[j] = from.mass_soft[i];
  to.mass_hard[j] = from.mass_hard[i];
  to.soft_plastic_strain_rate[j] = from.soft_plastic_strain_rate[i];
}

void copy_state(const std::vector<double>& from, int i, std::vector<double>& to, int j) {
  for (std::size_t row = 0; row < from.size(); row += kLanes) to[row + j] = from[row + i];
}

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

// Requires that lane j of `b` has the same outputs and states as lane i of `a`, bit for bit.
void expect_same(const Rig& a, int i, const Rig& b, int j) {
  const TileOutputs& x = a.outputs;
  const TileOutputs& y = b.outputs;
  ASSERT_TRUE(same_bits(x.shear_stress[i], y.shear_stress[j]));
  ASSERT_TRUE(same_bits(x.sliding_velocity[i], y.sliding_velocity[j]));
  ASSERT_TRUE(same_bits(x.interface_temperature[i], y.interface_temperature[j]));
  ASSERT_TRUE(same_bits(x.velocity_jump_new[i], y.velocity_jump_new[j]));
  ASSERT_TRUE(same_bits(x.friction_heat[i], y.friction_heat[j]));
  ASSERT_EQ(x.regime[i], y.regime[j]);
  ASSERT_EQ(x.outcome[i], y.outcome[j]);
  for (std::size_t row = 0; row < a.committed.size(); row += kLanes) {
    ASSERT_TRUE(same_bits(a.committed[row + i], b.committed[row + j])) << row / kLanes;
  }
}

class PhysicsLanes : public ::testing::TestWithParam<Solver> {};

TEST_P(PhysicsLanes, PermutedAndAloneGiveTheSameBits) {
  Draw draw(7);
  for (int scene = 0; scene < 60; ++scene) {
    const bool extreme = scene % 2 == 1;
    const ModelOptions options = random_options(draw, GetParam(), extreme);
    Rig rig(options), permuted(options), alone(options, 1);
    start_hard_elsewhere(draw, rig);
    std::array<int, kLanes> order;
    std::iota(order.begin(), order.end(), 0);
    for (int step = 0; step < 10; ++step) {
      random_inputs(draw, rig, extreme);
      for (int l = kLanes - 1; l > 0; --l) std::swap(order[l], order[draw.integer(0, l)]);
      for (int l = 0; l < kLanes; ++l) {
        copy_inputs(rig.inputs, l, permuted.inputs, order[l]);
        copy_state(rig.committed, l, permuted.committed, order[l]);
      }
      const int chosen = draw.integer(0, kLanes - 1);
      copy_inputs(rig.inputs, chosen, alone.inputs, 0);
      copy_state(rig.committed, chosen, alone.committed, 0);
      const double dt = random_dt(draw, extreme);
      rig.step(dt);
      permuted.step(dt);
      alone.step(dt);
      for (int l = 0; l < kLanes; ++l) expect_same(rig, l, permuted, order[l]);
      expect_same(rig, chosen, alone, 0);
      if (::testing::Test::HasFatalFailure()) return;
    }
  }
}

TEST_P(PhysicsLanes, InactiveLanesAreLeftAlone) {
  Draw draw(8);
  Rig rig(graded(random_options(draw, GetParam(), false)));
  for (int step = 0; step < 30; ++step) {
    random_inputs(draw, rig, true);
    rig.inputs.active = static_cast<std::uint32_t>(draw.integer(0, 255));
    const TileOutputs outputs = rig.outputs;
    const std::vector<double> committed = rig.committed;
    rig.step(1e-9);
    for (int l = 0; l < kLanes; ++l) {
      if (rig.inputs.active >> l & 1u) continue;
      for (std::size_t row = 0; row < committed.size(); row += kLanes) {
        ASSERT_TRUE(same_bits(rig.committed[row + l], committed[row + l]));
      }
      ASSERT_TRUE(same_bits(rig.outputs.shear_stress[l], outputs.shear_stress[l]));
      ASSERT_TRUE(same_bits(rig.outputs.interface_temperature[l], outputs.interface_temperature[l]));
      ASSERT_EQ(rig.outputs.outcome[l], outputs.outcome[l]);
    }
  }
}

TEST_P(PhysicsLanes, MirroredInputsGiveMirroredBits) {
  Draw draw(9);
  for (int scene = 0; scene < 60; ++scene) {
    const bool extreme = scene % 2 == 1;
    const ModelOptions options = random_options(draw, GetParam(), extreme);
    Rig rig(options), mirror(options);
    for (int step = 0; step < 15; ++step) {
      random_inputs(draw, rig, extreme);
      mirror.inputs = rig.inputs;
      for (int l = 0; l < kLanes; ++l) {
        mirror.inputs.velocity_jump[l] *= -1;
        mirror.inputs.soft_shear_rate[l] *= -1;
        mirror.inputs.stress_soft[l] *= -1;
        mirror.inputs.stress_hard[l] *= -1;
        mirror.inputs.soft_plastic_strain_rate[l] *= -1;
      }
      const double dt = random_dt(draw, extreme);
      rig.step(dt);
      mirror.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(rig.outputs.shear_stress[l], -mirror.outputs.shear_stress[l]);
        ASSERT_EQ(rig.outputs.sliding_velocity[l], -mirror.outputs.sliding_velocity[l]);
        ASSERT_EQ(rig.outputs.velocity_jump_new[l], -mirror.outputs.velocity_jump_new[l]);
        ASSERT_EQ(rig.outputs.friction_heat[l], mirror.outputs.friction_heat[l]);
        ASSERT_EQ(rig.outputs.regime[l], mirror.outputs.regime[l]);
        ASSERT_EQ(rig.outputs.outcome[l], mirror.outputs.outcome[l]);
      }
      const std::size_t without_stress = rig.model.layout().shear_stress;
      ASSERT_EQ(std::memcmp(rig.committed.data(), mirror.committed.data(), without_stress * sizeof(double)), 0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, PhysicsLanes,
                         ::testing::Values(Solver::kVelocityDriven, Solver::kForceDriven, Solver::kInertia,
                                           Solver::kInertiaHeat, Solver::kMeltFilm, Solver::kForcedInertiaHeat),
                         [](const auto& test) { return name_of(test.param); });

// For any factor L, the scaling (v, t, z, h, dt, m, rho) -> (L v, t/L^2, z/L, h/L, dt/L^2, m/L^3, rho/L^2) of velocity,
// time, depth, layer thickness, step length, mass and, in a layer with inertia, density changes neither temperature nor
// stress. The numerical scheme must keep this property of the equations.
class PhysicsSimilarity : public ::testing::TestWithParam<Strategy> {};

void expect_similar(Strategy strategy, bool inertia) {
  for (FarBoundary far : {FarBoundary::kInsulated, FarBoundary::kHalfSpace}) {
    for (double L : {2.0, 3.7, 1e-3}) {
      ModelOptions options = graded(paper_options(strategy));
      options.grid.far_boundary = far;
      options.inertia = inertia;
      ModelOptions scaled_options = options;
      scaled_options.grid.thickness /= L;
      if (inertia) scaled_options.soft.density /= L * L;
      Rig rig(options, 1), scaled(scaled_options, 1);
      rig.inputs.mass_soft[0] = 6.7575e-3;
      rig.inputs.mass_hard[0] = 19.75e-3;
      scaled.inputs.mass_soft[0] = rig.inputs.mass_soft[0] / (L * L * L);
      scaled.inputs.mass_hard[0] = rig.inputs.mass_hard[0] / (L * L * L);
      double jump = 100.0, scaled_jump = 100.0 * L;
      for (int n = 0; n < 400; ++n) {
        rig.set_all(jump, 11.2e9);
        scaled.set_all(scaled_jump, 11.2e9);
        rig.inputs.stress_soft[0] = scaled.inputs.stress_soft[0] = 150e6;
        rig.step(1e-9);
        scaled.step(1e-9 / (L * L));
        ASSERT_NEAR(rig.outputs.interface_temperature[0] / scaled.outputs.interface_temperature[0], 1.0, 1e-12) << n;
        ASSERT_NEAR(rig.outputs.shear_stress[0] / scaled.outputs.shear_stress[0], 1.0, inertia ? 1e-9 : 1e-11) << n;
        const double slip = L * rig.outputs.sliding_velocity[0];
        ASSERT_NEAR(scaled.outputs.sliding_velocity[0], slip, 1e-8 * std::abs(slip)) << n;
        if (strategy == Strategy::kForceDriven) {
          jump = rig.outputs.velocity_jump_new[0];
          scaled_jump = scaled.outputs.velocity_jump_new[0];
        }
      }
    }
  }
}

TEST_P(PhysicsSimilarity, ScaledProblemsHaveTheSameAnswer) {
  expect_similar(GetParam(), false);
}
TEST(PhysicsSimilarityOfWaves, ScaledProblemsHaveTheSameAnswer) {
  expect_similar(Strategy::kVelocityDriven, true);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsSimilarity, support::both<Strategy>(), support::name_of_strategy);

}  // namespace
}  // namespace shearbus::testing
