// Runs random scenes of the stability campaign for a short time. "shearbus-study stability --random" runs as many
// node-steps as requested.
#include <gtest/gtest.h>

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

}  // namespace
}  // namespace shearbus::study::stability
