// The number of iterations of a step with inertia is bounded. A step that would take hours reports a failure and keeps
// the state of the node.
#include <gtest/gtest.h>

#include <cstddef>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

// Cells of 0.25 nm and steps of 10 us give alpha dt/dz^2 = 1e10. If the interface comes close to melting, the solver
// needs hundreds of Newton steps for each heat flux that it tries, and for some of them thousands of evaluations of the
// stresses.
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
