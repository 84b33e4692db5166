// Random histories, checked against the invariants. Scenes, states and inputs are drawn from a seed, for every solver.
// The property tests run them for about a second, shearbus-study stability for as many node-steps as requested.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tests/campaign/campaign.hpp"
#include "tests/support/sleepers.hpp"

namespace shearbus::study::stability {

// A kind of random scenes, each kind for one solver: its name, and the function that draws the options of a scene.
struct RandomKind {
  std::string_view name;
  ModelOptions (*options)(testing::Draw& draw, bool extreme);  // null: of a kind that the seed draws
  bool several_pairs = false;                                  // the options are those of the first of several pairs
};
std::span<const RandomKind> random_kinds();
RandomKind kind_named(std::string_view name, bool several_pairs = false);

struct RandomOutcome {
  std::string name;  // name of the RandomKind or of the Physics
  long scenes = 0, extreme_scenes = 0;
  Figures figures;
  testing::Slept slept;
  SearchEffort most;  // largest counts of search work in one step of a tile of eight nodes
  struct Fault {
    std::uint64_t seed;  // seed of the history that failed
    std::string text;
  };
  std::vector<Fault> faults;
};

// Runs histories of scenes of one kind until they have at least `node_steps` node-steps together. The seeds count up
// from `first_seed`, one for each history. Half of the histories start from a random state.
RandomOutcome run_random(const RandomKind& kind, bool extreme, long node_steps, std::uint64_t first_seed);
// Runs random histories of all kinds in turn, in usual and in extreme scenes, for `node_steps` node-steps in all. What a seed
// draws for a kind does not depend on the other kinds.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed);
// Runs random histories with the options of one physics; only initial temperature, states and inputs are random.
RandomOutcome run_random(const Physics& physics, long node_steps, std::uint64_t first_seed);

}  // namespace shearbus::study::stability
