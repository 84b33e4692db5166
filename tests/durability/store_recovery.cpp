// Tests of the store with a simple substitute for a server, Counter. Whatever the disk does, recovery must return every
// settled record (written whole and synced as promised) exactly once and in order, or report that it cannot.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>

#include "server/store/checkpoint.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/store_server.hpp"

namespace shearbus::store {
namespace {

using Call = MemoryStorage::Call;

TEST(Store, CheckpointAndJournalTogetherGiveEverything) {
  MemoryStorage disk;
  Server(disk).run_to(20, 6);
  Server again(disk);
  EXPECT_EQ(again.counter.seen, up_to(20));
  EXPECT_EQ(again.store.counters().replayed, 2u);  // the records after the last checkpoint, 19 and 20
}

TEST(Store, TwoGenerationsStayAndTheJournalSinceTheOlder) {
  MemoryStorage disk;
  Server server(disk);
  server.run_to(30, 5);
  EXPECT_EQ(disk.names(),
            (std::vector<std::string>{checkpoint_name(5), checkpoint_name(6), segment_name(6), kIdentityName}));
}

TEST(Store, RefusesToStartEmptyOverFilesItCannotUse) {
  MemoryStorage disk;
  Server(disk).run_to(1, 1);
  disk.bytes(checkpoint_name(1))[1000] ^= std::byte{4};
  disk.remove(segment_name(1));  // this segment holds the whole history and would replace the checkpoint
  EXPECT_THAT(support::said_by<DamagedFile>([&] { Server{disk}; }), testing::HasSubstr("--accept-empty"));
  Server forced(disk, Durability::kPower, true);
  EXPECT_TRUE(forced.counter.seen.empty());
  EXPECT_TRUE(disk.exists(checkpoint_name(1) + ".unused"));
  forced.run(1);
  EXPECT_EQ(Server(disk).counter.seen, up_to(1));
}

TEST(Store, AJournalWithAHoleIsRefused) {
  MemoryStorage disk;
  for (std::uint64_t i = 1; i <= 3; ++i) Server(disk).run(i);  // each server writes a journal segment of its own
  disk.remove(segment_name(2));
  EXPECT_THROW(Server{disk}, DamagedFile);
}

TEST(Store, AJournalDamagedBeforeItsEndIsRefused) {
  MemoryStorage disk;
  Server(disk).run_to(3);
  disk.bytes(segment_name(1))[130] ^= std::byte{1};
  EXPECT_THROW(Server{disk}, DamagedFile);
}

// The result of a workload with checkpoints, on a disk that fails at one of its calls.
struct Outcome {
  std::vector<std::uint64_t> answered;
  bool fired = false;
};

Outcome workload(MemoryStorage& disk, Durability durability) {
  Outcome outcome;
  try {
    Server server(disk, durability);
    for (std::uint64_t i = server.counter.seen.size() + 1, end = i + 6; i < end; ++i) {
      try {
        server.run(i);
        outcome.answered = server.counter.seen;
      } catch (const StorageError& fault) {
        if (server.store.failed()) throw;
        EXPECT_TRUE(fault.no_space());
        break;  // on a full disk a request is refused and has no effect
      }
      if (i % 2 == 0) server.checkpoint();
    }
  } catch (const StorageError&) {
    // The server has stopped itself or has died. `outcome` contains the requests that were answered before.
  }
  outcome.fired = disk.fired();
  return outcome;
}

// Requires that a new server recovers all answered requests in order. It may recover one request more: the one that was
// running when the earlier server ended.
void expect_nothing_lost(MemoryStorage& disk, Durability durability, const std::vector<std::uint64_t>& answered,
                         const std::string& when) {
  SCOPED_TRACE(when);
  std::optional<Server> again;
  ASSERT_NO_THROW(again.emplace(disk, durability));
  const auto& seen = again->counter.seen;
  ASSERT_GE(seen.size(), answered.size()) << when;
  ASSERT_LE(seen.size(), answered.size() + 1) << when;
  ASSERT_EQ(seen, up_to(seen.size())) << when;
}

TEST(Store, FailureOfTheNthCallLosesNothingThatWasAnswered) {
  int faults = 0;
  for (const int code : {EIO, ENOSPC})
    for (const bool for_ever : {false, true})
      for (std::uint64_t n = 1;; ++n) {
        MemoryStorage disk;
        const auto before = workload(disk, Durability::kPower).answered;
        disk.plan({.at_call = n, .code = code, .for_ever = for_ever});
        auto outcome = workload(disk, Durability::kPower);
        if (outcome.answered.empty()) outcome.answered = before;
        disk.heal();
        expect_nothing_lost(disk, Durability::kPower, outcome.answered,
                            "call " + std::to_string(n) + " fails with " + std::to_string(code));
        if (!outcome.fired) break;
        ++faults;
      }
  EXPECT_GT(faults, 100);
  RecordProperty("faults", faults);
}

TEST(Store, DeathAtTheNthCallLosesNothingThatWasAnswered) {
  int deaths = 0;
  for (std::uint64_t n = 1;; ++n) {
    MemoryStorage disk;
    const auto before = workload(disk, Durability::kProcess).answered;
    disk.plan({.at_call = n});
    auto outcome = workload(disk, Durability::kProcess);
    if (outcome.answered.empty()) outcome.answered = before;
    disk.die_of_process();
    expect_nothing_lost(disk, Durability::kProcess, outcome.answered, "death at call " + std::to_string(n));
    if (!outcome.fired) break;
    ++deaths;
  }
  EXPECT_GT(deaths, 30);
}

TEST(Store, LossOfPowerAtTheNthCallLosesNothingThatWasAnswered) {
  int deaths = 0;
  for (unsigned seed = 0; seed < 20; ++seed)
    for (std::uint64_t n = 1;; ++n) {
      std::mt19937 random(seed * 1000 + static_cast<unsigned>(n));
      MemoryStorage disk;
      const auto before = workload(disk, Durability::kPower).answered;
      disk.plan({.at_call = n});
      auto outcome = workload(disk, Durability::kPower);
      if (outcome.answered.empty()) outcome.answered = before;
      disk.die_of_power(random);
      expect_nothing_lost(disk, Durability::kPower, outcome.answered,
                          "power lost at call " + std::to_string(n) + ", seed " + std::to_string(seed));
      if (HasFatalFailure()) return;
      if (!outcome.fired) break;
      ++deaths;
    }
  EXPECT_GT(deaths, 600);
  RecordProperty("deaths", deaths);
}

// The server dies before the sync of a record, the next one reads it from the machine's cache and goes on after it, and
// then the power fails.
TEST(Store, ARecordThatTheNextServerReadsIsDurable) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    MemoryStorage disk;
    std::mt19937 random(seed);
    {
      Server server(disk);
      server.run(1);
      disk.plan({.at_call = 1, .of = Call::kSync});
      EXPECT_THROW(server.run(2), StorageError);
    }
    disk.die_of_process();
    {
      Server server(disk);
      ASSERT_EQ(server.counter.seen, up_to(2));
      server.run(3);
    }
    disk.die_of_power(random);
    EXPECT_EQ(Server(disk).counter.seen, up_to(3)) << "seed " << seed;
  }
}

TEST(Store, AReadThatFailsIsToldAlthoughAnEmptySegmentFollows) {
  MemoryStorage disk;
  Server(disk).run(1);
  disk.put(segment_name(2), {});
  Server(disk).run(2);
  ASSERT_TRUE(disk.exists(segment_name(3)));
  int failed = 0;
  for (std::uint64_t n = 1;; ++n) {
    disk.plan({.at_call = n, .code = EIO, .of = Call::kRead});
    try {
      EXPECT_EQ(Server(disk).counter.seen, up_to(2));
    } catch (const StorageError& fault) {
      EXPECT_EQ(fault.code(), EIO);
      ++failed;
    } catch (const std::exception& fault) {
      ADD_FAILURE() << "read " << n << ": " << fault.what();
    }
    if (!disk.fired()) break;
  }
  EXPECT_GE(failed, 3);
}

TEST(Store, ACheckpointThatFailsLeavesTheOnesBefore) {
  for (const Call call :
       {Call::kCreate, Call::kAppend, Call::kSync, Call::kRename, Call::kSyncDirectory, Call::kRead}) {
    MemoryStorage disk;
    Server server(disk);
    server.run_to(4, 2);
    server.run(5);
    disk.plan({.at_call = 1, .code = ENOSPC, .of = call});
    EXPECT_FALSE(server.checkpoint());
    disk.heal();
    EXPECT_EQ(server.store.counters().checkpoints_failed, 1u);
    server.run(6);
    EXPECT_TRUE(server.checkpoint());
    server.run(7);
    EXPECT_EQ(Server(disk).counter.seen, up_to(7));
  }
}

}  // namespace
}  // namespace shearbus::store
