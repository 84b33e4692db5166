// Runs random scenes of the stability campaign for a short time. "shearbus-study stability --random" runs as many
// node-steps as requested.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <utility>
#include <vector>

#include "tests/campaign/random.hpp"

namespace shearbus::study::stability {
namespace {

TEST(Random, InvariantsHoldFromAnyState) {
  for (const RandomOutcome& one : run_random(200000, 1)) {
    std::printf("%s: %ld scenes, %ld node-steps; sums %d, limits %d, waves %d\n", one.name.c_str(), one.scenes,
                one.figures.node_steps, one.most.layer_sums, one.most.limit_values, one.most.wave_evaluations);
    EXPECT_GT(one.extreme_scenes, 0) << one.name;
    EXPECT_GT(one.scenes, one.extreme_scenes) << one.name;
    for (const RandomOutcome::Fault& fault : one.faults) {
      ADD_FAILURE() << one.name << ", seed " << fault.seed << ": " << fault.text;
    }
  }
}

// A history that once broke a law.
struct BrokenOnce {
  const char* kind;
  bool extreme;
  std::uint64_t seed;
  bool several_pairs = false;
};
constexpr bool kExtreme = true, kSeveralPairs = true;
constexpr BrokenOnce kBrokenOnce[] = {
    {"force-driven", !kExtreme, 309},  // friction that rises past what a layer at its ceiling carries
    {"inertia", kExtreme, 1703},
    {"force-driven", kExtreme, 2393, kSeveralPairs},  // junctions of almost no height next to sticking
    {"inertia", kExtreme, 5791},
    {"force-driven, two components", kExtreme, 9266},  // junctions of almost no height next to sticking
    {"melt film", kExtreme, 17664},                    // films that carry far less than the contact
    {"melt film", kExtreme, 24667, kSeveralPairs},     // films that carry far less than the contact
    {"force-driven, two components", kExtreme, 31723, kSeveralPairs},
    {"force-driven", !kExtreme, 34455},
    {"force-driven", kExtreme, 36786},
    {"force-driven, two components", kExtreme, 37771, kSeveralPairs},
    {"force-driven", kExtreme, 44024},
    {"velocity-driven, two components", !kExtreme, 53330},  // a strain that grows by less than its last digit
    {"force-driven, two components", kExtreme, 102576},     // a limit whose g nearly vanishes far below melting
    {"inertia, plastic heating", !kExtreme, 145},           // a vertex that its neighbours melt takes no heat
    {"inertia, plastic heating", !kExtreme, 356},           // likewise
    {"inertia, plastic heating", !kExtreme, 316},           // waves that tell a slip to few of its digits
    {"inertia, plastic heating", kExtreme, 129},            // likewise
    {"inertia, plastic heating", kExtreme, 2102},           // likewise
    {"force-driven, inertia, plastic heating", !kExtreme,
     108},  // a heat that is closed to the digits of fast masses alone
    {"force-driven, inertia, plastic heating", kExtreme, 52},   // a heat that is next to nothing of the work without it
    {"force-driven, inertia, plastic heating", kExtreme, 69},   // work that the last digit of a temperature changes
    {"force-driven, inertia, plastic heating", kExtreme, 145},  // likewise
    {"force-driven, inertia, plastic heating", kExtreme, 476},  // likewise
    {"force-driven, inertia, plastic heating", kExtreme, 455},  // a vertex that flows by the rounding of a slip at rest
    {"force-driven, inertia, plastic heating", kExtreme, 6},    // a contact without an answer that was open before
};

TEST(Random, LawsHoldWhereTheyOnceBroke) {
  for (const BrokenOnce& history : kBrokenOnce) {
    const RandomKind kind = kind_named(history.kind, history.several_pairs);
    const RandomOutcome outcome = run_random(kind, history.extreme, 1, history.seed);
    EXPECT_EQ(outcome.scenes, 1);
    for (const RandomOutcome::Fault& fault : outcome.faults)
      ADD_FAILURE() << kind.name << ", seed " << fault.seed << ": " << fault.text;
  }
}

// Flowing layers under force to a tolerance, in half of the histories with extreme inputs. In seed 75 a jump that is far
// smaller than the step's change of it turns; in 370 and 474 slip takes over from flow, and what the substep lacks of its
// mean stress would bring this above the friction.
TEST(Random, InvariantsHoldWhereALayerFlowsUnderForceToATolerance) {
  constexpr long kNodeSteps = 10000;
  const std::vector<Physics> all = all_physics();
  const auto physics = std::ranges::find(all, "force, plastic layer, tolerance", &Physics::name);
  ASSERT_NE(physics, all.end());
  long node_steps = 0;
  for (const auto& [seed, asked] : {std::pair{51u, kNodeSteps}, {370u, 1L}, {474u, 1L}}) {
    const RandomOutcome outcome = run_random(*physics, asked, seed);
    node_steps += outcome.figures.node_steps;
    for (const RandomOutcome::Fault& fault : outcome.faults)
      ADD_FAILURE() << "seed " << fault.seed << ": " << fault.text;
  }
  EXPECT_GE(node_steps, kNodeSteps / 2);
}

}  // namespace
}  // namespace shearbus::study::stability
