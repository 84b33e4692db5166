// Counts the allocations of a step: those of a whole round trip, in client, server and libzmq together, and those of
// solver and shard alone. A count does not depend on the load of the machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"
#include "tests/support/counted_malloc.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using wire::Strategy;

constexpr int kWarmUp = 6;  // steps until every memory that is kept has been allocated
constexpr int kCounted = 21;
constexpr double kDt = 1e-9;

// Returns the median of the allocations of a call, by all threads. Rare allocations of libzmq's threads, such as a new
// chunk of a queue every 256 messages, are not in it.
template <typename Call>
long median_allocations(const Call& call) {
  for (int i = 0; i < kWarmUp; ++i) call();
  std::vector<long> counts;
  for (int i = 0; i < kCounted; ++i) {
    const long before = support::allocations_of_program;
    call();
    counts.push_back(support::allocations_of_program - before);
  }
  std::ranges::nth_element(counts, counts.begin() + kCounted / 2);
  return counts[kCounted / 2];
}

struct Trip {
  const char* transport;
  Strategy strategy;
  std::size_t nodes;
};

class RoundTrip : public testing::TestWithParam<Trip> {};

TEST_P(RoundTrip, AllocatesAtMostTwentyTimes) {
  if (!support::kCountsAllocations) GTEST_SKIP() << "the sanitizer has an allocator of its own";
  constexpr long kMost = 20;
  const Trip& trip = GetParam();
  server::ServerOptions options;
  options.threads = 1;
  support::RunningServer server(options);
  Client client = server.client(trip.transport);
  const auto ids = support::node_ids(trip.nodes);
  Session session = client.open(support::text_of(support::scene_of(trip.strategy)), "scene", ids);
  const Batch request = support::step_columns(trip.strategy, ids, 0);
  const long advance = median_allocations([&] { session.advance(request, {.dt_s = kDt}); });
  session.trial(request, {.dt_s = kDt});
  const long trial = median_allocations([&] { session.trial(request, {.dt_s = kDt, .commit_previous = true}); });
  session.commit();
  const Batch named = support::step_columns(trip.strategy, std::span(ids).first(trip.nodes / 2), 0, true);
  const long part = median_allocations([&] { session.advance(named, {.dt_s = kDt}); });
  std::cout << trip.transport << ", " << trip.nodes << " nodes: " << advance << " allocations of advance, " << trial
            << " of trial, " << part << " of half of the nodes\n";
  EXPECT_LE(advance, kMost);
  EXPECT_LE(trial, kMost);
  EXPECT_LE(part, kMost);
}

INSTANTIATE_TEST_SUITE_P(TransportAndSize, RoundTrip,
                         testing::Values(Trip{"ipc", Strategy::kForceDriven, 100},
                                         Trip{"ipc", Strategy::kForceDriven, 1'000},
                                         Trip{"ipc", Strategy::kVelocityDriven, 100},
                                         Trip{"tcp", Strategy::kForceDriven, 1'000},
                                         Trip{"inproc", Strategy::kForceDriven, 1'000}),
                         [](const auto& test) {
                           return std::string(test.param.transport) + std::to_string(test.param.nodes) +
                                  (test.param.strategy == Strategy::kForceDriven ? "ForceDriven" : "VelocityDriven");
                         });

// All options whose steps allocate nothing; a step under a tolerance has memory for the substeps of its tile.
class Scenes : public testing::TestWithParam<Strategy> {};

TEST_P(Scenes, SolverAndShardAllocateNothing) {
  if (!support::kCountsAllocations) GTEST_SKIP() << "the sanitizer has an allocator of its own";
  const Strategy strategy = GetParam();
  const auto ids = support::node_ids(1'000);
  for (const unsigned threads : {1U, 2U}) {
    shard::TaskPool pool(threads);
    shard::Shard shard(physics::Model(service::scene_model(support::scene_of(strategy)).options), ids,
                       std::vector<double>(ids.size(), 300.0), pool, {.nodes_per_task = 128});
    const wire::Batch request = support::step_columns(strategy, ids, 0);
    wire::Batch reply = wire::Batch::of(wire::columns_of(strategy).reply, ids.size());
    const shard::StepColumns columns = service::step_columns(request, reply, kDt);
    shard::Rows rows;
    rows.all = true;
    std::shared_ptr<shard::Shard::StepRun> run;
    const long allocations = median_allocations([&] {
      const auto operators = shard.operators(kDt);
      run = shard.prepare(rows, *operators, columns, std::move(run));
      shard.begin(*run);
      while (!shard.work(*run, 1e4)) {
      }
      shard.finish(*run);
      shard.commit();
    });
    EXPECT_EQ(allocations, 0) << threads << " threads";
  }
}

INSTANTIATE_TEST_SUITE_P(Strategies, Scenes, testing::Values(Strategy::kForceDriven, Strategy::kVelocityDriven),
                         [](const auto& test) {
                           return test.param == Strategy::kForceDriven ? "ForceDriven" : "VelocityDriven";
                         });

}  // namespace
}  // namespace shearbus
