// Random histories of a shard of several pairs of materials. Each node must have the bits that it has in a tile of its
// pair alone, and those are held to the invariants.
#pragma once

#include "tests/campaign/random.hpp"

namespace shearbus::study::stability {

// Runs a history of `steps` steps, of which the first pair has the given options. Throws testing::Broken where an
// invariant or an equality of bits does not hold.
void run_pairs(testing::Draw& draw, const ModelOptions& first, bool extreme, int steps, RandomOutcome& outcome);

}  // namespace shearbus::study::stability
