// Runs random scenes of the stability campaign for a short time. "shearbus-study stability --random" runs as many
// node-steps as requested.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>

#include "tests/campaign/random.hpp"

namespace shearbus::study::stability {
namespace {

TEST(Random, InvariantsHoldFromAnyState) {
  for (const RandomOutcome& one : run_random(200000, 1)) {
    std::printf("%s: %ld scenes, %ld node-steps; sums %d, limits %d, newton %d\n", one.name.c_str(), one.scenes,
                one.figures.node_steps, one.most.layer_sums, one.most.limit_values, one.most.newton_steps);
    for (const RandomOutcome::Fault& fault : one.faults) {
      ADD_FAILURE() << one.name << ", seed " << fault.seed << ": " << fault.text;
    }
  }
}

// Histories that once broke a law: junctions of almost no height next to sticking (2393 in several pairs, 9266 in two
// components), a limit whose g nearly vanishes far below melting (102576), films that carry far less than the contact
// (17664, 24667), friction that rises past what a layer at its ceiling carries (309), and others where the last digits decide.
TEST(Random, LawsHoldWhereTheyOnceBroke) {
  for (const std::uint64_t seed :
       {309, 1703, 2393, 5791, 9266, 17664, 24667, 31723, 34455, 36786, 37771, 44024, 53330, 102576}) {
    for (const RandomOutcome& one : run_random(1, seed)) {
      for (const RandomOutcome::Fault& fault : one.faults)
        ADD_FAILURE() << one.name << ", seed " << fault.seed << ": " << fault.text;
    }
  }
}

}  // namespace
}  // namespace shearbus::study::stability
