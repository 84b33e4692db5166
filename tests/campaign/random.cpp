#include "tests/campaign/random.hpp"

#include <array>

#include "tests/support/random_history.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, draws of tests/support

namespace {

constexpr int kSteps = 25;

constexpr std::array kKinds = {
    RandomKind{"velocity-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kVelocityDriven, e); }},
    RandomKind{"force-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kForceDriven, e); }},
    RandomKind{"inertia", random_inertia_options},
    RandomKind{"melt film", random_melting_options},
    RandomKind{"velocity-driven, two components",
               [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kVelocityDriven, e); }},
    RandomKind{"force-driven, two components",
               [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kForceDriven, e); }},
};

// Runs a history of random inputs with `options`, from the initial state or from a random state.
void run_history(Draw& draw, const ModelOptions& options, bool extreme, std::uint64_t seed, RandomOutcome& outcome) {
  Rig rig(options);
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

template <class RunSeed>
void run_seeds(long node_steps, std::uint64_t seed, const RunSeed& run_seed) {
  for (long taken = 0; taken < node_steps; taken += long{kSteps} * kLanes) run_seed(seed++);
}

}  // namespace

std::span<const RandomKind> random_kinds() {
  return kKinds;
}

RandomOutcome run_random(const RandomKind& kind, bool extreme, long node_steps, std::uint64_t first_seed) {
  RandomOutcome outcome{.name = kind.name};
  run_seeds(node_steps, first_seed, [&](std::uint64_t seed) {
    Draw draw(seed);
    run_history(draw, kind.options(draw, extreme), extreme, seed, outcome);
  });
  return outcome;
}

// Each seed is one history. Successive seeds give a usual scene of every kind, then an extreme scene of every kind, and
// so on.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed) {
  std::vector<RandomOutcome> outcomes(kKinds.size());
  for (std::size_t i = 0; i < kKinds.size(); ++i) outcomes[i].name = kKinds[i].name;
  run_seeds(node_steps, first_seed, [&](std::uint64_t seed) {
    const bool extreme = seed / kKinds.size() % 2 == 1;
    const std::size_t kind = seed % kKinds.size();
    Draw draw(seed);
    const ModelOptions options = kKinds[kind].options(draw, extreme);
    run_history(draw, options, extreme, seed, outcomes[kind]);
  });
  return outcomes;
}

RandomOutcome run_random(const Physics& physics, long node_steps, std::uint64_t first_seed) {
  RandomOutcome outcome{.name = physics.name};
  run_seeds(node_steps, first_seed, [&](std::uint64_t seed) {
    Draw draw(seed);
    ModelOptions options = physics.options;
    const double T_melt = options.soft.melting_temperature;
    if (draw.chance(0.3)) options.initial_temperature = T_melt * (1.0 - draw.log_uniform(1e-9, 0.1));
    run_history(draw, options, seed % 2 == 1, seed, outcome);
  });
  return outcome;
}

}  // namespace shearbus::study::stability
