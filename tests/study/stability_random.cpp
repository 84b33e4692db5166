#include "tests/study/stability_random.hpp"

#include <array>

#include "tests/support/random_history.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs and draws

namespace {

constexpr int kSteps = 25;

struct Kind {
  const char* name;
  ModelOptions (*options)(Draw& draw, bool extreme);
};
constexpr std::array kKinds = {
    Kind{"velocity-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kVelocityDriven, e); }},
    Kind{"force-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kForceDriven, e); }},
    Kind{"inertia", random_inertia_options},
    Kind{"velocity-driven, two components",
         [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kVelocityDriven, e); }},
    Kind{"force-driven, two components",
         [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kForceDriven, e); }},
};

// What a seed stands for: usual and extreme scenes of every kind in turn.
void run_seed(std::uint64_t seed, RandomOutcome& outcome) {
  const std::uint64_t turn = seed / kKinds.size();
  const bool extreme = turn % 2 == 1;
  Draw draw(seed);
  Rig rig(kKinds[seed % kKinds.size()].options(draw, extreme));
  SearchEffort effort;
  rig.inputs.effort = &effort;
  if (draw.chance(0.5)) {
    random_state(draw, rig);
  } else {
    start_hard_elsewhere(draw, rig);
  }
  ++outcome.scenes;
  try {
    random_history(draw, rig, extreme, kSteps, outcome.figures, [&] {
      require_effort(effort, rig);
      take_most(outcome.most, effort);
      effort = {};
    });
  } catch (const Broken& broken) {
    outcome.faults.push_back({seed, broken.what()});
  }
}

}  // namespace

std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t seed) {
  std::vector<RandomOutcome> outcomes(kKinds.size());
  for (std::size_t i = 0; i < kKinds.size(); ++i) outcomes[i].name = kKinds[i].name;
  long taken = 0;
  for (; taken < node_steps; ++seed) {
    run_seed(seed, outcomes[seed % kKinds.size()]);
    taken += long{kSteps} * kLanes;
  }
  return outcomes;
}

}  // namespace shearbus::study::stability
