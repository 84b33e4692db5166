// The bits of an answer do not depend on the machine, the build type or the width of the vector registers.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>

#include "server/physics/layer/registers.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// FNV-1a hash of the state of a tile at the end of a history in which its lanes load, flow, melt, open and stick.
std::uint64_t fingerprint(const ModelOptions& options) {
  Rig rig(options);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 6.7575e-3;
    rig.inputs.mass_hard[l] = 19.75e-3;
  }
  for (int n = 0; n < 400; ++n) {
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.velocity_jump[l] = (l % 2 == 0 ? 1.0 : -1.0) * (1.0 + 40.0 * l) * (n < 300 ? 1.0 : -0.25);
      rig.inputs.pressure[l] = n % 100 == 99 ? -1e9 : 1e9 * (1.0 + l);
      rig.inputs.stress_soft[l] = 2e7 * l;
    }
    rig.step(n % 3 == 0 ? 1e-9 : 2.5e-9);
  }
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (double value : rig.committed) hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 0x100000001b3u;
  return hash;
}

TEST(PhysicsBits, AreTheSameOnEveryMachine) {
  ModelOptions options = graded(paper_options());
  EXPECT_EQ(fingerprint(options), 3892226390501435262u);
  options.drive = Drive::kInterfaceSlip;
  options.soft.yield_strength_max = 0.4e9;
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  EXPECT_EQ(fingerprint(options), 10625513143263007472u);
  EXPECT_EQ(fingerprint(graded(paper_options(Strategy::kForceDriven))), 18251289367800343332u);
}

// The kernels of flow: expanded, with a force-driven flux, and searched.
TEST(PhysicsBits, OfFlowAreTheSameInRegistersOfAnyWidth) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  ModelOptions plastic = graded(paper_options(Strategy::kForceDriven));
  plastic.plastic_layer = true;
  plastic.interface.yield_strength = 400e6;
  ModelOptions johnson_cook = graded(paper_options()), preston = johnson_cook, plastic_preston = plastic;
  johnson_cook.soft = make_material("copper_ofhc_jc", {}).material;
  preston.soft = plastic_preston.soft = make_material("copper_ofhc_ptw", {}).material;
  for (const ModelOptions& options : {plastic, johnson_cook, preston, plastic_preston}) {
    const std::uint64_t four = fingerprint(options);
    registers_of_four = false;
    EXPECT_EQ(fingerprint(options), four);
    registers_of_four = true;
  }
}

// Kernels with registers of two and of four doubles give the same bits, whatever the scene and its history.
TEST(PhysicsBits, AreTheSameInRegistersOfAnyWidth) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  Draw draw(97);
  int compared = 0;
  for (int scene = 0; compared < 40; ++scene) {
    const bool extreme = scene % 2 == 1;
    ModelOptions options =
        random_options(draw, scene % 4 == 0 ? Strategy::kVelocityDriven : Strategy::kForceDriven, extreme);
    options.tolerance.reset();
    if (!refusals(options).empty()) continue;
    ++compared;
    Rig four(options), two(options);
    for (int step = 0; step < 20; ++step) {
      random_inputs(draw, four, extreme);
      two.inputs = four.inputs;
      const double dt = std::max(random_dt(draw, extreme), shortest_step(options));
      four.step(dt);
      registers_of_four = false;
      two.step(dt);
      registers_of_four = true;
      ASSERT_EQ(std::memcmp(four.committed.data(), two.committed.data(), four.committed.size() * sizeof(double)), 0)
          << "scene " << scene << ", step " << step;
    }
  }
}

}  // namespace
}  // namespace shearbus::testing
