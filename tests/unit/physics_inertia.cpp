// Steps of a layer with inertia, as a host sees them. tests/property tests the equations of these steps,
// tests/convergence compares them with exact solutions.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 1e9;  // compression of the contact [Pa]
constexpr double kElastic = 3.0;   // velocity jump for which the layer stays elastic [m/s]

TEST(PhysicsInertia, AWaveArrivesAfterACrossingAndIsDoubledAtTheHardBody) {
  const ModelOptions options = with_inertia(paper_options());
  ModelOptions coarse = options;
  coarse.grid.cells = 200;
  const double cross = coarse.grid.thickness / shear_speed(coarse.soft);
  EXPECT_NEAR(cross, 6.26e-9, 0.01e-9);
  const double Z = impedance(coarse.soft);
  Rig rig(coarse, 1);
  rig.set_all(0.0, kPressure);
  rig.step(1e-12);  // closes the contact with the layer at rest
  rig.set_all(kElastic, kPressure);
  const double dt = 4e-12;
  double arrived = 0.0;
  for (int n = 1; n * dt < 2.9 * cross; ++n) {
    rig.step(dt);
    const double t = n * dt;
    if (arrived == 0.0 && rig.stress() > Z * kElastic) arrived = t;  // s(0) exceeds half of 2 Z V, its final value
    if (t < 0.85 * cross) {
      ASSERT_LT(std::abs(rig.stress()), 1e-3 * Z * kElastic) << t;
    }
    if (t > 1.3 * cross && t < 2.7 * cross) {
      ASSERT_NEAR(rig.stress(), 2.0 * Z * kElastic, 0.01 * Z * kElastic) << t;
    }
    if (t > 0.5 * cross && t < 1.7 * cross) {
      ASSERT_NEAR(stress_at(rig, 200), Z * kElastic, 0.01 * Z * kElastic) << t;
    }
    if (t > 2.4 * cross) {
      ASSERT_NEAR(stress_at(rig, 200), 3.0 * Z * kElastic, 0.01 * Z * kElastic) << t;
    }
  }
  EXPECT_NEAR(arrived, cross, 0.01 * cross);
}

TEST(PhysicsInertia, AContactThatClosesMeetsTheLayerMovingWithItsBody) {
  ModelOptions options = with_inertia(graded(paper_options()));
  Rig rig(options, 1);
  rig.set_all(kElastic, -1e9);
  rig.step(1e-10);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kOpen);
  EXPECT_EQ(rig.outputs.sliding_velocity[0], kElastic);
  for (int c = 0; c < 60; ++c) EXPECT_EQ(velocity_in(rig, c), kElastic);
  // When the contact closes, the layer stops at z = 0, and s(0) is the stress Z V of a wave that runs into the layer.
  rig.set_all(kElastic, kPressure);
  for (int n = 0; n < 100; ++n) rig.step(1e-11);
  EXPECT_NEAR(rig.stress(), impedance(options.soft) * kElastic, 1e-3 * impedance(options.soft) * kElastic);
  EXPECT_NEAR(velocity_in(rig, 0), 0.0, 1e-3 * kElastic);
  EXPECT_NEAR(velocity_in(rig, 59), kElastic, 1e-3 * kElastic);
  // When the contact opens again, every stress in the layer becomes 0.
  rig.set_all(kElastic, 0.0);
  rig.step(1e-10);
  for (int i = 0; i <= 60; ++i) EXPECT_EQ(stress_at(rig, i), 0.0);
  for (int c = 0; c < 60; ++c) EXPECT_EQ(velocity_in(rig, c), kElastic);
}

TEST(PhysicsInertia, CoulombHoldsTheInterfaceAndTheLayerSlipsThere) {
  ModelOptions options = with_inertia(graded(paper_options()));
  options.friction_coefficient = 0.01;
  Rig rig(options, 1);
  rig.set_all(20.0, kPressure);
  for (int n = 0; n < 50; ++n) rig.step(1e-11);
  EXPECT_EQ(rig.stress(), 0.01 * kPressure);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kCoulomb);
  // Friction sends a wave of stress mu P into the layer, which slows the layer's face at z = 0 by mu P / Z (Z:
  // impedance). The rest of the jump is slip of the interface.
  EXPECT_NEAR(rig.outputs.sliding_velocity[0], 20.0 - 0.01 * kPressure / impedance(options.soft), 1e-3);
  EXPECT_EQ(rig.plastic_slip(), 0.0);
  // DLP (18): the heat is that of the whole imposed jump, not only of the slip.
  EXPECT_NEAR(rig.outputs.friction_heat[0], rig.conducted_share() * 0.01 * kPressure * 20.0 * 1e-11, 1e-12);
}

// What the soft body loses with the mean stress at z = h, and the hard one gains with that at z = 0, is what the layer
// gains, in momentum.
TEST(PhysicsInertia, MomentumOfTheLayerIsTheImpulseOfItsTwoFaces) {
  for (const bool stages : {false, true}) {
    ModelOptions options = with_inertia(graded(paper_options()));
    if (stages) options = of_second_order(options);
    Rig rig(options, 1);
    rig.inputs.wants_mean_stress = true;
    double jump = 0.0;
    for (int n = 1; n <= 400; ++n) {
      const Grid& grid = rig.model.grid();
      const bool first = n == 1;
      jump = 120.0 * std::sin(2e7 * n * 1e-9);
      double before = 0.0, after = 0.0, size = 0.0;
      for (int c = 0; c < grid.num_cells(); ++c)
        before += options.soft.density * grid.width[c] * (first ? jump : velocity_in(rig, c));
      rig.set_all(jump, 11.2e9);
      rig.step(1e-9);
      for (int c = 0; c < grid.num_cells(); ++c) {
        after += options.soft.density * grid.width[c] * velocity_in(rig, c);
        size += options.soft.density * grid.width[c] * 120.0;
      }
      const double near = rig.outputs.mean_shear_stress[0], far = rig.outputs.mean_far_stress[0];
      ASSERT_NEAR(after - before, 1e-9 * (far - near), 1e-11 * size) << n;
      if (stages) continue;
      ASSERT_EQ(near, stress_at(rig, 0));
      ASSERT_EQ(far, stress_at(rig, grid.num_cells()));
    }
  }
}

// For any factor L, the scaling (v, t, z, h, dt, rho) -> (L v, t/L^2, z/L, h/L, dt/L^2, rho/L^2) of velocity, time,
// depth, layer thickness, step length and density changes neither temperature nor stress.
TEST(PhysicsInertia, ScaledProblemsHaveTheSameAnswer) {
  for (double L : {2.0, 3.7}) {
    ModelOptions options = with_inertia(graded(paper_options()));
    ModelOptions scaled_options = options;
    scaled_options.grid.thickness /= L;
    scaled_options.soft.density /= L * L;
    Rig rig(options, 1), scaled(scaled_options, 1);
    for (int n = 0; n < 400; ++n) {
      rig.set_all(100.0, 11.2e9);
      scaled.set_all(100.0 * L, 11.2e9);
      rig.step(1e-9);
      scaled.step(1e-9 / (L * L));
      for (int i = 0; i <= 60; i += 10) ASSERT_NEAR(stress_at(rig, i) / stress_at(scaled, i), 1.0, 1e-9) << n;
      ASSERT_NEAR(rig.outputs.interface_temperature[0] / scaled.outputs.interface_temperature[0], 1.0, 1e-12) << n;
    }
  }
}

TEST(PhysicsInertia, WithoutItALayerKeepsNoField) {
  const TileLayout plain = Model(graded(paper_options())).layout();
  EXPECT_EQ(plain.layer_velocity, TileLayout::kAbsent);
  EXPECT_EQ(plain.doubles, (61 + 61 + 3) * std::size_t{kLanes});
  const TileLayout layout = Model(with_inertia(graded(paper_options()))).layout();
  EXPECT_EQ(layout.doubles, plain.doubles + (60 + 60 - 1) * std::size_t{kLanes});  // and no rate of the stress
}

}  // namespace
}  // namespace shearbus::testing
