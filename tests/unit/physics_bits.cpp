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
  EXPECT_EQ(fingerprint(options), 13625119805906446880u);
  options.drive = Drive::kInterfaceSlip;
  options.soft.yield_strength_max = 0.4e9;
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  EXPECT_EQ(fingerprint(options), 623370120967998468u);
  EXPECT_EQ(fingerprint(graded(paper_options(Strategy::kForceDriven))), 12157287553264453915u);
  EXPECT_EQ(fingerprint(discretised(paper_options(), 1e-2)), 11158150850311134610u);
  EXPECT_EQ(fingerprint(discretised(paper_options(Strategy::kForceDriven), 1e-2)), 8632006070987338636u);
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

// Steps random scenes in registers of four and of two doubles, and one lane of each tile without the other lanes, and
// compares the bits. `next_scene` draws the options of a scene.
template <class NextScene>
void compare_widths(Draw& draw, int scenes, const NextScene& next_scene) {
  int compared = 0;
  for (int scene = 0; compared < scenes; ++scene) {
    const bool extreme = scene % 2 == 1;
    ModelOptions options = next_scene(scene, extreme);
    options.tolerance.reset();
    if (!refusals(options).empty()) continue;
    ++compared;
    const int lane = scene % kLanes;
    Rig four(options), two(options), alone(options, 1u << lane);
    for (int step = 0; step < 20; ++step) {
      random_inputs(draw, four, extreme);
      two.inputs = alone.inputs = four.inputs;
      alone.inputs.active = 1u << lane;
      const double dt = std::max(random_dt(draw, extreme), shortest_step(options));
      four.step(dt);
      alone.step(dt);
      registers_of_four = false;
      two.step(dt);
      registers_of_four = machine_has_registers_of_four();
      ASSERT_EQ(std::memcmp(four.committed.data(), two.committed.data(), four.committed.size() * sizeof(double)), 0)
          << "scene " << scene << ", step " << step;
      for (std::size_t i = static_cast<std::size_t>(lane); i < four.committed.size(); i += kLanes) {
        ASSERT_EQ(std::bit_cast<std::uint64_t>(alone.committed[i]), std::bit_cast<std::uint64_t>(four.committed[i]))
            << "scene " << scene << ", step " << step << ", row " << i / kLanes;
      }
    }
  }
}

// Kernels with registers of two and of four doubles give the same bits, whatever the scene and its history.
TEST(PhysicsBits, AreTheSameInRegistersOfAnyWidth) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  Draw draw(97);
  compare_widths(draw, 60, [&](int scene, bool extreme) {
    const Solver kinds[] = {Solver::kVelocityDriven, Solver::kForceDriven,   Solver::kInertia,
                            Solver::kForceDriven,    Solver::kForcedInertia, Solver::kInertiaHeat};
    return random_options(draw, kinds[scene % 6], extreme);
  });
}

// The same for work that heats in place in layers with inertia under force.
TEST(PhysicsBits, AreTheSameInRegistersOfAnyWidthWhereWorkHeatsUnderForce) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  Draw draw(99);
  compare_widths(draw, 10, [&](int, bool extreme) { return random_forced_inertia_heat_options(draw, extreme); });
}

// The same for work that heats a plastic layer: the searches of the lanes of a register change where their heat goes one by
// one.
TEST(PhysicsBits, AreTheSameInRegistersOfAnyWidthWhereAPlasticLayerHeatsInPlace) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  Draw draw(100);
  compare_widths(draw, 200, [&](int, bool extreme) {
    ModelOptions options = random_options(draw, Strategy::kForceDriven, extreme);
    if (options.soft.flow_law != FlowLaws::place<SteinbergCochranGuinan>()) options.soft = paper_options().soft;
    options.plastic_layer = true;
    options.hard_grid = options.grid;
    options.taylor_quinney_factor = 0.9;
    options.modes.reset();
    options.melt_film.reset();
    return options;
  });
}

// The same for each limit that the kernels of the force-driven step have: junctions, friction that falls with slip or
// temperature, both orders in time.
TEST(PhysicsBits, AreTheSameInRegistersOfAnyWidthUnderEveryFriction) {
  if (!machine_has_registers_of_four()) GTEST_SKIP() << "this machine has registers of two doubles only";
  constexpr int kLimits = 7;
  Draw draw(98);
  compare_widths(draw, 10 * kLimits, [&](int scene, bool extreme) {
    const int limit = scene % kLimits;
    ModelOptions options = random_options(draw, Strategy::kForceDriven, extreme);
    const double yield_strength = options.soft.yield_strength;
    if (options.soft.flow_law != FlowLaws::place<SteinbergCochranGuinan>()) options.soft = paper_options().soft;
    options.plastic_layer = false;
    options.junctions.reset();
    options.interface.friction_law = {};
    options.time_integrator = limit >= 5 ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler;
    if (limit == 1 || limit == 4) {
      options.junctions = {draw.uniform(0.1, 1.0), draw.log_uniform(1e-9, 1e-6), paper_options().soft};
      options.junctions->metal.yield_strength = yield_strength;
    }
    if (limit == 2) {
      options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
      options.interface.friction_coefficient_fast = options.interface.friction_coefficient * draw.uniform(0.0, 1.5);
      options.interface.velocity_decay = draw.log_uniform(1e-3, 1.0);
    }
    if (limit == 3 || limit == 4 || limit == 6) {
      options.interface.friction_law = FrictionLaws::place<ThermalSoftening>();
      options.interface.friction_reference_temperature = draw.uniform(1.0, 1000.0);
      options.interface.friction_softening_exponent = draw.uniform(1.0, 4.0);
    }
    return options;
  });
}

}  // namespace
}  // namespace shearbus::testing
