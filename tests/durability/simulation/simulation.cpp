// Clients and server in one thread, on a network that loses, repeats, delays and reorders packets, and on a disk that
// fails at any of its calls, or whose machine dies during the call. A seed determines everything. Each answered call is
// repeated on a reference server that runs undisturbed, and the two answers must have the same bits. Six faults
// therefore show as a difference at the next step: a request that is lost after its answer (P1), runs twice (P2),
// changes the state although refused (P3) or comes from a dead client (P4), a damaged checkpoint that is loaded (P5),
// and a replay that differs (P6). Hosts register, retire and hand over nodes. A ledger holds every node that must
// exist; at the end each of these nodes must be in exactly one session or waiting offer.
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <memory>
#include <set>
#include <span>
#include <vector>

#include "tests/durability/simulation/host.hpp"

namespace shearbus::simulation {
namespace {

// Requires that every node of the ledger exists exactly once: in the session of a host, or in an offer that waits to be
// accepted.
void expect_none_lost_and_none_twice(const Ledger& ledger, std::span<const std::unique_ptr<Host>> hosts) {
  std::multiset<std::uint64_t> found;
  for (const auto& host : hosts) found.insert(host->nodes().begin(), host->nodes().end());
  for (const Ledger::Offer& offer : ledger.offers)
    if (offer.waits) found.insert(offer.nodes.begin(), offer.nodes.end());
  ASSERT_EQ(found, ledger.nodes);
  ASSERT_EQ(hosts.front()->nodes_of_server(), ledger.nodes.size());
}

// Runs three hosts of one domain; two have the same scene, so nodes can move between them.
void simulate(unsigned seed, Tally& tally, std::size_t rows = wire::kMaxRowsPerMessage) {
  World world(seed, tally);
  Ledger ledger;
  support::ServiceHarness reference;
  constexpr Strategy kStrategies[] = {Strategy::kVelocityDriven, Strategy::kForceDriven};
  std::vector<std::unique_ptr<Host>> hosts;
  for (unsigned i = 0; i < 3; ++i)
    hosts.push_back(std::make_unique<Host>(world, tally, ledger, reference, i,
                                           kStrategies[(seed / 2 + (i == 2 ? 1 : 0)) % 2], rows));
  for (int i = 0; i < 40; ++i) {
    hosts[world.random() % hosts.size()]->act();
    if (::testing::Test::HasFailure()) return;
  }
  expect_none_lost_and_none_twice(ledger, hosts);
  for (const auto& host : hosts) host->close();
}

// Seed 2682 found a bug with a late copy of an opening request that had met a full disk. Seed 1407 found a bug with a
// checkpoint that was missing in the list of checkpoints and existed longer than its journal.
TEST(Simulation, SeedsThatOnceFoundABugFindNone) {
  Tally tally;
  for (const unsigned seed : {392U, 1407U, 2682U}) {
    SCOPED_TRACE(seed);
    simulate(seed, tally);
  }
}

// The environment variable SHEARBUS_SEED sets the first seed and SHEARBUS_SEEDS the number of seeds. If only
// SHEARBUS_SEED is set, one seed runs; if neither is set, `usual` seeds run.
struct Seeds {
  explicit Seeds(unsigned usual) {
    const char* one = std::getenv("SHEARBUS_SEED");
    const char* many = std::getenv("SHEARBUS_SEEDS");
    if (one != nullptr) first = static_cast<unsigned>(std::strtoul(one, nullptr, 10));
    count = many != nullptr ? static_cast<unsigned>(std::strtoul(many, nullptr, 10)) : one != nullptr ? 1 : usual;
  }
  unsigned first = 1;
  unsigned count;
};

// Of nearly every step one part is under way before the part before it is answered.
TEST(Simulation, StepsInPartsSentAheadHaveTheAnswersOfAServerToWhichNothingHappens) {
  const Seeds seeds(150);
  Tally tally;
  for (unsigned seed = seeds.first; seed < seeds.first + seeds.count && !HasFailure(); ++seed) {
    SCOPED_TRACE("SHEARBUS_SEED=" + std::to_string(seed));
    try {
      simulate(seed, tally, 2 + seed % 4);
    } catch (const std::exception& fault) {
      ADD_FAILURE() << fault.what();
    }
  }
  if (seeds.count >= 100) {
    EXPECT_GT(tally.crashes, seeds.count / 2);
  }
}

TEST(Simulation, WhateverHappensTheAnswersAreThoseOfAServerToWhichNothingDoes) {
  const auto [first, count] = Seeds(300);
  Tally tally;
  for (unsigned seed = first; seed < first + count; ++seed) {
    SCOPED_TRACE("SHEARBUS_SEED=" + std::to_string(seed));
    try {
      simulate(seed, tally);
    } catch (const std::exception& fault) {
      ADD_FAILURE() << fault.what();
    }
    if (HasFailure()) break;
  }
  std::cout << count << " seeds from " << first << ": " << tally.calls << " calls, " << tally.crashes << " crashes, "
            << tally.disk_faults << " servers with a planned disk fault, " << tally.checkpoints << " checkpoints, "
            << tally.damaged << " of them damaged, " << tally.dropped << " messages lost, " << tally.repeated
            << " repeated, " << tally.successors << " clients died, " << tally.node_changes
            << " changes of the set of nodes, " << tally.moved << " nodes moved, " << tally.held
            << " requests answered after others; nodes lost or owned twice, answers that differ: "
            << (HasFailure() ? "SOME" : "0") << "\n";
  if (count < 100) return;  // few seeds, run to find a fault
  EXPECT_GT(tally.crashes, count / 2);
  EXPECT_GT(tally.held, count);
}

}  // namespace
}  // namespace shearbus::simulation
