// Random states and inputs against the invariants: histories of scenes drawn from a seed, of every solver in turn.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

struct RandomOutcome {
  std::string name;  // of the solver
  long scenes = 0;
  Figures figures;
  SearchEffort most;  // in one step of eight lanes
  struct Fault {
    std::uint64_t seed;  // which repeats it
    std::string text;
  };
  std::vector<Fault> faults;
};

// Scenes of the seeds from `first_seed` on, until so many node-steps have been taken.
std::vector<RandomOutcome> run_random(long node_steps, std::uint64_t first_seed);
// Likewise states and inputs of one physics.
RandomOutcome run_random(const Physics& physics, long node_steps, std::uint64_t first_seed);

}  // namespace shearbus::study::stability
