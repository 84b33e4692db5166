// Sleep of nodes at rest (server/physics/METHODS.md, "Sleep"), with all options that can be combined with sleep: in
// each single step a sleeping node must answer as if it were awake, and keep the heat that it would then have.
#include <gtest/gtest.h>

#include "tests/support/sleepers.hpp"

namespace shearbus::testing {
namespace {

constexpr int kPhases = 6;

ModelOptions random_sleeping_options(Draw& draw, Strategy strategy, bool extreme) {
  ModelOptions options = random_options(draw, strategy, extreme);
  options.modes.reset();
  options.time_integrator = TimeIntegrator::kBackwardEuler;
  if (!goes_with(Property::kSleep, options)) options.interface.friction_law = {};
  options.sleep = true;
  Draw aside = draw;
  if (aside.chance(0.3)) {
    options.grid.far_boundary = FarBoundary::kIsothermal;
    if (options.hard_grid && aside.chance(0.7)) options.hard_grid->far_boundary = FarBoundary::kIsothermal;
  }
  if (options.drive == Drive::kLayerShear && draw.chance(0.3)) options.tangential_components = 2;
  return options;
}

// Runs a scene beside its twin that stays awake, and calls `look` after each step.
template <class Look>
void run_beside_its_twin(Draw& draw, const ModelOptions& options, int scene, bool extreme, Slept& slept,
                         const Look& look) {
  Rig rig(options);
  AwakeTwin awake(options);
  start_hard_elsewhere(draw, rig);
  Phase phase{};
  for (int step = 0; step < kPhases * kStepsPerPhase; ++step) {
    if (step % kStepsPerPhase == 0) phase = begin_phase(draw, rig, extreme);
    within_phase(phase, rig);
    const double dt = random_dt(draw, extreme);
    rig.step(dt);
    ASSERT_NO_THROW(awake.repeat(rig, dt, slept)) << "scene " << scene << ", step " << step;
    look(rig);
  }
}

class PhysicsSleepSteps : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsSleepSteps, ASleeperAnswersAsIfItWereAwake) {
  Draw draw(20261);
  Slept slept;
  for (int scene = 0; scene < 80; ++scene) {
    const bool extreme = scene % 4 == 3;
    const ModelOptions options = random_sleeping_options(draw, GetParam(), extreme);
    ASSERT_NO_FATAL_FAILURE(run_beside_its_twin(draw, options, scene, extreme, slept, [](const Rig&) {}));
  }
  printf("asleep %ld node-steps, %ld of them stuck under stress, woke %ld times; apart by %.1e K\n", slept.asleep,
         slept.stuck, slept.woken, slept.apart);
  EXPECT_GT(slept.asleep, 40000);
  EXPECT_GT(slept.stuck, 4000);
  EXPECT_GT(slept.woken, 300);
  EXPECT_LT(slept.apart, 1e-11);  // 1.8e-12 force-driven
}

// A node whose interface may melt sleeps while all of it is solid, and wakes where a pressure that falls would melt it.
TEST(PhysicsSleepNextToAFilm, ASleeperToAFilmAnswersAsIfItWereAwake) {
  Draw draw(20262);
  Slept slept;
  long molten = 0;
  for (int scene = 0; scene < 40; ++scene) {
    const bool extreme = scene % 4 == 3;
    ModelOptions options = random_melting_options(draw, extreme);
    options.sleep = true;
    ASSERT_NO_FATAL_FAILURE(run_beside_its_twin(draw, options, scene, extreme, slept, [&](const Rig& rig) {
      for (int l = 0; l < kLanes; ++l) molten += rig.outputs.film_thickness[l] > 0.0;
    }));
  }
  printf("asleep %ld node-steps, %ld of them stuck under stress, woke %ld times, molten %ld; apart by %.1e K\n",
         slept.asleep, slept.stuck, slept.woken, molten, slept.apart);
  EXPECT_GT(slept.asleep, 5000);
  EXPECT_GT(slept.stuck, 500);
  EXPECT_GT(slept.woken, 50);
  EXPECT_GT(molten, 100);
}

INSTANTIATE_TEST_SUITE_P(Strategies, PhysicsSleepSteps,
                         ::testing::Values(Strategy::kVelocityDriven, Strategy::kForceDriven),
                         [](const auto& strategy) {
                           return strategy.param == Strategy::kForceDriven ? "ForceDriven" : "VelocityDriven";
                         });

}  // namespace
}  // namespace shearbus::testing
