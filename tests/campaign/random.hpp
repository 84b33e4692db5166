// Random histories under the invariants: scenes, states and inputs drawn from a seed, for every solver. The property
// tests run them for a second, shearbus-study stability as long as asked.
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

// Runs histories of one kind, a seed each from `first_seed` on, for at least so many node-steps. Half of them start
// from a drawn state.
RandomOutcome run_random(const RandomKind& kind, bool extreme, long node_steps, std::uint64_t first_seed);
// Likewise all kinds in turn, usual and extreme scenes.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed);
// Likewise one physics, with drawn states and inputs.
RandomOutcome run_random(const Physics& physics, long node_steps, std::uint64_t first_seed);

}  // namespace shearbus::study::stability
