// Steps of a layer with inertia, as a host sees them, velocity-driven and under force between the masses of the host.
// tests/property tests the equations of these steps and compares with the twin, tests/convergence compares them with
// exact solutions.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "tests/support/random_physics.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

double mass_behind(const Rig& rig, int lane) {
  const ModelOptions& options = rig.model.options();
  return rig.inputs.mass_soft[lane] - options.soft.density * options.grid.thickness;
}

// An elastic layer whose interface sticks: after a push the energy of both bodies, of the layer and its elasticity never
// grows, in either order.
TEST(PhysicsInertiaForced, AnElasticLayerNeverGainsEnergy) {
  for (const bool stages : {false, true}) {
    ModelOptions options = with_inertia(graded(paper_options(Strategy::kForceDriven)));
    options.plastic_layer = true;
    options.soft.yield_strength = 1e12;
    options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
    options.interface = {.friction_coefficient = 1e3, .yield_strength = 1e12};
    if (stages) options = of_second_order(options);
    Rig rig(options, 1);
    rig.set_all(0.0, 11.2e9);
    const double dt = 0.3e-9;
    double hard = 0.0, energy = 0.0, before = 0.0;
    for (int n = 0; n < 400; ++n) {
      for (int l = 0; l < kLanes; ++l) {
        rig.inputs.mass_soft[l] = 0.08;
        rig.inputs.mass_hard[l] = 0.02;
        rig.inputs.stress_soft[l] = n < 20 ? 4e8 : 0.0;
        rig.inputs.stress_hard[l] = n < 10 ? -3e8 : 0.0;
        if (n > 0) rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
      }
      rig.step(dt);
      ASSERT_EQ(rig.outputs.regime[0], Regime::kStick) << n;
      ASSERT_EQ(rig.outputs.friction_heat[0], 0.0) << n;
      hard += dt * (rig.outputs.shear_stress[0] - rig.inputs.stress_hard[0]) / rig.inputs.mass_hard[0];
      const Grid& grid = rig.model.grid();
      const auto kinetic = [](double mass, double v) { return 0.5 * mass * v * v; };
      energy = kinetic(rig.inputs.mass_hard[0], hard) +
               kinetic(mass_behind(rig, 0), hard + velocity_in(rig, grid.num_cells()));
      for (int c = 0; c < grid.num_cells(); ++c)
        energy += kinetic(options.soft.density * grid.width[c], hard + velocity_in(rig, c));
      for (int i = 0; i <= grid.num_cells(); ++i)
        energy += 0.5 * grid.weight[i] * std::pow(stress_at(rig, i), 2) / options.soft.shear_modulus;
      if (n > 20) {
        ASSERT_LE(energy, before * (1.0 + 1e-12)) << n;
      }
      before = energy;
    }
    EXPECT_GT(energy, 0.0);
  }
}

// A host without any mass behind the layer has no answer, and keeps its state; the server refuses it before.
TEST(PhysicsInertiaForced, AHalfZoneLighterThanTheLayerHasNoAnswer) {
  ModelOptions options = with_inertia(graded(paper_options(Strategy::kForceDriven)));
  options.plastic_layer = true;
  Rig rig(options);
  rig.set_all(100.0, 11.2e9);
  rig.step(1e-9);
  const std::vector<double> before = rig.committed;
  const double layer = options.soft.density * options.grid.thickness;
  rig.inputs.mass_soft[3] = layer * (1.0 - 1e-12);
  rig.step(1e-9);
  for (int l = 0; l < kLanes; ++l) EXPECT_EQ((rig.outputs.outcome[l] & kFailed) != 0, l == 3) << l;
  for (std::size_t i = 3; i < before.size(); i += kLanes) ASSERT_EQ(rig.committed[i], before[i]);
}

// The number of iterations of a step with inertia is bounded: a step that would take hours reports a failure and keeps
// the state of the node. Cells of 0.25 nm and steps of 10 us give alpha dt/dz^2 = 1e10. If the interface comes close to
// melting, the solver needs hundreds of Newton steps for each heat flux that it tries, and for some of them thousands of
// evaluations of the stresses.
Rig thin_layer() {
  ModelOptions options = paper_options(Strategy::kVelocityDriven);
  options.grid.thickness = 25e-9;
  options.grid.cells = 100;
  options.grid.grading = 1.0;
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.inertia = true;
  return Rig(options);
}

TEST(PhysicsWavesGivenUp, WhatWouldTakeForEverHasNoAnswerAndKeepsTheState) {
  Rig rig = thin_layer();
  const double velocities[kLanes] = {0.1, 1.0, 10.0, 50.0, 1e2, 3e2, 1e3, 1e4};
  int answered = 0, failed = 0;
  for (int step = 0; step < 20 && failed == 0; ++step) {
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.velocity_jump[l] = step % 2 == 0 ? velocities[l] : -velocities[l];
      rig.inputs.pressure[l] = 11.2e9;
    }
    const auto before = rig.committed;
    rig.step(1e-5);
    for (int l = 0; l < kLanes; ++l) {
      if ((rig.outputs.outcome[l] & kFailed) == 0) {
        ++answered;
        EXPECT_LT(rig.outputs.interface_temperature[l], rig.model.options().soft.melting_temperature);
        continue;
      }
      ++failed;
      EXPECT_EQ(rig.outputs.friction_heat[l], 0.0);
      for (std::size_t i = static_cast<std::size_t>(l); i < before.size(); i += kLanes)
        ASSERT_EQ(before[i], rig.committed[i]) << "lane " << l << ", row " << i / kLanes;
    }
  }
  EXPECT_GT(answered, 16);
  EXPECT_GT(failed, 0);
}

}  // namespace
}  // namespace shearbus::testing
