// Random histories under the invariants: scenes, states and inputs are drawn from a seed, for every solver. The
// property tests run them for about a second, shearbus-study stability for as many node-steps as requested.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

// A solver with the distribution of its scenes.
struct RandomKind {
  const char* name;
  ModelOptions (*options)(testing::Draw& draw, bool extreme);
};
std::span<const RandomKind> random_kinds();

struct RandomOutcome {
  std::string name;  // name of the kind or of the physics
  long scenes = 0;
  Figures figures;
  SearchEffort most;  // largest effort of a step of eight lanes
  struct Fault {
    std::uint64_t seed;  // seed that repeats the history
    std::string text;
  };
  std::vector<Fault> faults;
};

// Runs histories of one kind, each with its own seed from `first_seed` on, until there are at least `node_steps`
// node-steps. Half of the histories start from a random state.
RandomOutcome run_random(const RandomKind& kind, bool extreme, long node_steps, std::uint64_t first_seed);
// Runs all kinds in turn in the same way, with usual and extreme scenes.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed);
// Runs one physics in the same way, with random states and inputs.
RandomOutcome run_random(const Physics& physics, long node_steps, std::uint64_t first_seed);

}  // namespace shearbus::study::stability
