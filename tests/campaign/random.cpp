#include "tests/campaign/random.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>

#include "tests/campaign/random_pairs.hpp"
#include "tests/campaign/random_scenes.hpp"
#include "tests/support/invariants/linearised.hpp"
#include "tests/support/random_history.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, draws of tests/support

namespace {

constexpr int kSteps = 25;
constexpr int kStepsWithSleep = 3 * kStepsPerPhase;

// A new kind goes to the end (of_pairs()).
constexpr std::array kOfOnePair = {
    RandomKind{"velocity-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kVelocityDriven, e); }},
    RandomKind{"force-driven", [](Draw& d, bool e) { return random_options(d, Strategy::kForceDriven, e); }},
    RandomKind{"inertia", random_inertia_options},
    RandomKind{"force-driven, inertia", random_forced_inertia_options},
    RandomKind{"inertia, plastic heating", random_inertia_heat_options},
    RandomKind{"melt film", random_melting_options},
    RandomKind{"velocity-driven, two components",
               [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kVelocityDriven, e); }},
    RandomKind{"force-driven, two components",
               [](Draw& d, bool e) { return random_two_component_options(d, Strategy::kForceDriven, e); }},
    RandomKind{"force-driven, inertia, plastic heating", random_forced_inertia_heat_options},
};

constexpr auto kKinds = [] {
  std::array<RandomKind, kOfOnePair.size() + 1> all{};
  std::copy(kOfOnePair.begin(), kOfOnePair.end(), all.begin());
  all.back() = {"several pairs", nullptr, true};
  return all;
}();

// The kind of one pair that a seed gives to several pairs. A kind that is added at the end takes its share of the seeds,
// and leaves the others what they had.
const RandomKind& of_pairs(std::uint64_t seed) {
  Draw draw(seed);
  const RandomKind* drawn = nullptr;
  double kinds = 0.0;
  for (const RandomKind& kind : kOfOnePair)
    if (draw.uniform(0.0, 1.0) * (kinds += 1.0) < 1.0) drawn = &kind;
  return *drawn;
}

int steps_of(const ModelOptions& options) {
  return options.sleep ? kStepsWithSleep : kSteps;
}

// Runs a history of random inputs with `options`, from the initial state or from a random state.
void run_history(Draw& draw, const ModelOptions& options, bool extreme, RandomOutcome& outcome) {
  Rig rig(options);
  std::optional<AwakeTwin> awake;
  // Under SDIRK2 and a tolerance a sleeper decays without an error in time, and differs from a node that is solved by that error.
  if (options.sleep && options.time_integrator == TimeIntegrator::kBackwardEuler && !options.tolerance)
    awake.emplace(options);
  SearchEffort effort;
  rig.inputs.effort = &effort;
  if (draw.chance(0.5)) {
    random_state(draw, rig);
  } else {
    start_hard_elsewhere(draw, rig);
  }
  random_history(draw, rig, extreme, steps_of(options), outcome.figures, [&](double dt) {
    if (awake) awake->repeat(rig, dt, outcome.slept);
    require_effort(effort, rig);
    take_most(outcome.most, effort);
    effort = {};
    const TileOutputs found = linearised(rig);
    for (int lane = 0; lane < kLanes; ++lane) require_linearised(rig, found, lane);
  });
}

// Runs the history of one seed, and records what breaks.
void run_seed(const RandomKind& kind, bool extreme, std::uint64_t seed, RandomOutcome& outcome) {
  Draw draw(seed);
  if (kind.several_pairs) draw.integer(0, 5);  // not used: the seeds of tests/stability/random.cpp keep their scenes
  const RandomKind& of = kind.options != nullptr ? kind : of_pairs(seed);
  const ModelOptions options = with_further_options(draw, of.options(draw, extreme), extreme);
  ++outcome.scenes;
  outcome.extreme_scenes += extreme;
  try {
    kind.several_pairs ? run_pairs(draw, options, extreme, steps_of(options), outcome)
                       : run_history(draw, options, extreme, outcome);
  } catch (const Broken& broken) {
    outcome.faults.push_back(
        {seed, fmt::format("{} scene of kind \"{}\": {}", extreme ? "extreme" : "usual", of.name, broken.what())});
  }
}

template <class RunSeed>
void run_seeds(long node_steps, std::uint64_t seed, const RunSeed& run) {
  for (long taken = 0; taken < node_steps; taken += long{kSteps} * kLanes) run(seed++);
}

}  // namespace

std::span<const RandomKind> random_kinds() {
  return kKinds;
}

RandomKind kind_named(std::string_view name, bool several_pairs) {
  RandomKind kind = *std::ranges::find(kKinds, name, &RandomKind::name);
  kind.several_pairs = several_pairs;
  return kind;
}

RandomOutcome run_random(const RandomKind& kind, bool extreme, long node_steps, std::uint64_t first_seed) {
  RandomOutcome outcome{.name = std::string(kind.name)};
  run_seeds(node_steps, first_seed, [&](std::uint64_t seed) { run_seed(kind, extreme, seed, outcome); });
  return outcome;
}

// Each seed gives a usual scene of every kind, then an extreme scene of every kind, each of which draws from a generator
// of its own.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed) {
  std::vector<RandomOutcome> outcomes;
  for (const RandomKind& kind : kKinds) outcomes.push_back({.name = std::string(kind.name)});
  long history = 0;
  run_seeds(node_steps, 0, [&](std::uint64_t) {
    const auto turn = std::div(history++, static_cast<long>(2 * kKinds.size()));
    const std::size_t kind = static_cast<std::size_t>(turn.rem) % kKinds.size();
    run_seed(kKinds[kind], static_cast<std::size_t>(turn.rem) >= kKinds.size(),
             first_seed + static_cast<std::uint64_t>(turn.quot), outcomes[kind]);
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
    ++outcome.scenes;
    try {
      run_history(draw, options, seed % 2 == 1, outcome);
    } catch (const Broken& broken) {
      outcome.faults.push_back({seed, broken.what()});
    }
  });
  return outcome;
}

}  // namespace shearbus::study::stability
