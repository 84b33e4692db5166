// Sleep of nodes at rest (server/physics/METHODS.md, "Sleep"), with all options that can be combined with sleep: in
// each single step a sleeping node must answer as if it were awake. tests/unit/physics_sleep.cpp compares models over
// many steps.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/problem.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr int kPhases = 6, kStepsPerPhase = 60;

ModelOptions random_sleeping_options(Draw& draw, Strategy strategy, bool extreme) {
  ModelOptions options = random_options(draw, strategy, extreme);
  options.modes.reset();
  options.time_integrator = TimeIntegrator::kBackwardEuler;
  options.sleep = true;
  if (options.drive == Drive::kLayerShear && draw.chance(0.3)) options.tangential_components = 2;
  return options;
}

// What the host does to each lane (node) in the kStepsPerPhase steps of a phase. `open`: the contact is open. `quiet`:
// the velocity jump starts at 0 and the far stresses are reduced. `lets_go`: the host slowly unloads a quiet lane.
struct Phase {
  bool open[kLanes], quiet[kLanes], lets_go[kLanes];
};

Phase begin_phase(Draw& draw, Rig& rig, bool extreme) {
  Phase phase{};
  random_vectors(draw, rig, extreme);
  for (int l = 0; l < kLanes; ++l) {
    phase.open[l] = draw.chance(0.3);
    phase.quiet[l] = draw.chance(0.7);
    phase.lets_go[l] = draw.chance(0.3);
    if (!phase.open[l] && rig.inputs.pressure[l] <= 0.0) rig.inputs.pressure[l] = draw.log_uniform(1e6, 30e9);
    if (phase.open[l]) rig.inputs.pressure[l] = -1.0;
    if (!phase.quiet[l]) continue;
    // The inputs of a quiet lane: the far stresses are 0.001 to 1 times those drawn, and the velocity jump starts at 0.
    const double share = draw.log_uniform(1e-3, 1.0);
    TileInputs& in = rig.inputs;
    in.velocity_jump[l] = in.second_velocity_jump[l] = in.soft_plastic_strain_rate[l] = 0.0;
    for (double* rows : {in.stress_soft, in.stress_hard, in.second_stress_soft, in.second_stress_hard})
      rows[l] *= share;
    in.soft_shear_rate[l] = draw.chance(0.5) ? 0.0 : draw.sign() * draw.log_uniform(1.0, 1e4);
  }
  return phase;
}

void within_phase(const Phase& phase, Rig& rig, bool forced) {
  for (int l = 0; l < kLanes; ++l) {
    if (forced && phase.quiet[l]) {
      rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
      rig.inputs.second_velocity_jump[l] = rig.outputs.second_velocity_jump_new[l];
    } else if (phase.quiet[l] && phase.lets_go[l]) {
      rig.inputs.velocity_jump[l] = -1e-9 * rig.stress(l);
    }
  }
}

class PhysicsSleepSteps : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsSleepSteps, ASleeperAnswersAsIfItWereAwake) {
  Draw draw(20261);
  const bool forced = GetParam() == Strategy::kForceDriven;
  int asleep = 0, stuck = 0, woke = 0;
  double apart = 0.0;
  for (int scene = 0; scene < 80; ++scene) {
    const bool extreme = scene % 4 == 3;
    ModelOptions options = random_sleeping_options(draw, GetParam(), extreme);
    Rig rig(options);
    const Problem problem(options);
    options.sleep = false;
    Rig awake(options);
    const TileLayout& layout = awake.model.layout();
    start_hard_elsewhere(draw, rig);
    Phase phase{};
    for (int step = 0; step < kPhases * kStepsPerPhase; ++step) {
      if (step % kStepsPerPhase == 0) phase = begin_phase(draw, rig, extreme);
      within_phase(phase, rig, forced);
      // 1. Copy the states to the model without sleep. A sleeping node stores amplitudes of heat modes, from which its
      // temperatures are computed.
      std::copy_n(rig.committed.begin(), layout.doubles, awake.committed.begin());
      std::uint32_t slept = 0;
      for (int l = 0; l < kLanes; ++l) {
        if (!physics::asleep(rig.model.layout(), rig.committed.data(), l)) continue;
        slept |= 1u << l;
        profile_of(problem, rig.committed.data(), l, awake.committed.data() + layout.first_temperature());
      }
      awake.inputs = rig.inputs;
      const double dt = random_dt(draw, extreme);
      rig.step(dt);
      awake.step(dt);
      // 2. Compare the models with and without sleep: all bits must be equal, except those of T0 in lanes that continue
      // to sleep.
      for (int l = 0; l < kLanes; ++l) {
        const TileOutputs &here = rig.outputs, &there = awake.outputs;
        const bool sleeps = (here.outcome[l] & kAsleep) != 0;
        ASSERT_EQ(here.outcome[l] & ~kAsleep, there.outcome[l]) << scene << ", " << step << ", " << l;
        ASSERT_EQ(here.regime[l], there.regime[l]) << scene << ", " << step << ", " << l;
        ASSERT_EQ(here.shear_stress[l], there.shear_stress[l]) << scene << ", " << step << ", " << l;
        ASSERT_EQ(here.sliding_velocity[l], there.sliding_velocity[l]);
        ASSERT_EQ(here.velocity_jump_new[l], there.velocity_jump_new[l]);
        ASSERT_EQ(here.friction_heat[l], there.friction_heat[l]);
        ASSERT_EQ(rig.outputs.second_shear_stress[l], awake.outputs.second_shear_stress[l]);
        for (std::size_t i = layout.temperature + layout.num_vertices * kLanes + l; i < layout.doubles; i += kLanes)
          ASSERT_EQ(rig.committed[i], awake.committed[i]) << "row " << i / kLanes;
        const double off = std::abs(here.interface_temperature[l] - there.interface_temperature[l]);
        if (sleeps) apart = std::max(apart, off);
        ASSERT_TRUE(sleeps || off == 0.0);
        asleep += sleeps;
        stuck += sleeps && here.regime[l] == Regime::kStick && here.shear_stress[l] != 0.0;
        woke += !sleeps && (slept >> l & 1u) != 0;
      }
    }
  }
  printf("asleep %d node-steps, %d of them stuck under stress, woke %d times; apart by %.1e K\n", asleep, stuck, woke,
         apart);
  EXPECT_GT(asleep, 40000);
  EXPECT_GT(stuck, 4000);
  EXPECT_GT(woke, 300);
  EXPECT_LT(apart, 3e-8);  // 1.8e-8 force-driven, rounding in the modes of a half-space of finely graded cells
}
INSTANTIATE_TEST_SUITE_P(Strategies, PhysicsSleepSteps,
                         ::testing::Values(Strategy::kVelocityDriven, Strategy::kForceDriven),
                         [](const auto& strategy) {
                           return strategy.param == Strategy::kForceDriven ? "ForceDriven" : "VelocityDriven";
                         });

}  // namespace
}  // namespace shearbus::testing
