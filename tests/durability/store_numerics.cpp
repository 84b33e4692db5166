// A journal that another version of the numerics wrote (P11): its requests are replayed by that version only.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/refused.hpp"
#include "tests/support/store_server.hpp"

namespace shearbus::store {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

// A server whose numerics have a version of their own.
struct VersionedServer {
  VersionedServer(MemoryStorage& disk, std::uint16_t numerics, bool accept_empty = false)
      : store(disk, {.durability = Durability::kProcess,
                     .epoch = 5,
                     .numerics = numerics,
                     .fresh_id = {1},
                     .accept_empty = accept_empty}) {
    store.recover(counter);
  }
  void run(std::uint64_t value) {
    const auto frame = bytes_of(value);
    store.append({.sequence = value, .header_frame = frame});
    counter.seen.push_back(value);
    store.settle();
  }

  Counter counter;
  Store store;
};

TEST(Numerics, ATailOfAnotherVersionIsRefusedByNameAndACleanStopLeavesNone) {
  MemoryStorage disk;
  {
    VersionedServer server(disk, 3);
    for (std::uint64_t i = 1; i <= 4; ++i) server.run(i);
    ASSERT_TRUE(write_checkpoint(server.store, server.counter.snapshot()));
    for (std::uint64_t i = 5; i <= 7; ++i) server.run(i);
  }
  for (const bool accept_empty : {false, true}) {
    const auto names = disk.names();
    EXPECT_THAT(support::said_by<std::runtime_error>([&] { VersionedServer(disk, 4, accept_empty); }),
                AllOf(HasSubstr("record 4 "), HasSubstr("answered by numerics 3"),
                      HasSubstr("this server has numerics 4"), HasSubstr("stop it cleanly")));
    EXPECT_EQ(disk.names(), names) << "a refused start changes nothing";
  }
  {
    VersionedServer finishes(disk, 3);
    EXPECT_EQ(finishes.counter.seen, up_to(7));
    ASSERT_TRUE(write_checkpoint(finishes.store, finishes.counter.snapshot())) << "as a clean stop does";
  }
  VersionedServer next(disk, 4);
  EXPECT_EQ(next.counter.seen, up_to(7));
  next.run(8);
}

// The model of another version of the numerics has other states, as with a tolerance, whose cells are its choice.
struct OtherModel final : Recovery {
  void restore(const Snapshot&) override {
    throw std::invalid_argument("state column temperature_k [56 values] is not the model's temperature_k [1][71]");
  }
  void replay(const Record&, std::uint64_t) override { ADD_FAILURE() << "nothing is left to replay"; }
  void clear() override {}
};

TEST(Numerics, ACheckpointWhoseStatesAreNotTheModelsNamesTheVersionThatWroteIt) {
  MemoryStorage disk;
  {
    VersionedServer server(disk, 3);
    for (std::uint64_t i = 1; i <= 4; ++i) server.run(i);
    ASSERT_TRUE(write_checkpoint(server.store, server.counter.snapshot()));
  }
  const auto refusal = [&](std::uint16_t numerics, bool accept_empty) -> std::string {
    const auto names = disk.names();
    OtherModel model;
    Store store(disk, {.durability = Durability::kProcess,
                       .epoch = 5,
                       .numerics = numerics,
                       .fresh_id = {1},
                       .accept_empty = accept_empty});
    try {
      store.recover(model);
    } catch (const std::exception& fault) {
      EXPECT_EQ(disk.names(), names) << "a refused start changes nothing";
      return fault.what();
    }
    return "";
  };
  for (const bool accept_empty : {false, true})
    EXPECT_THAT(refusal(4, accept_empty),
                AllOf(HasSubstr("checkpoint-"), HasSubstr("is not the model's"), HasSubstr("of numerics 3"),
                      HasSubstr("this server has numerics 4"), HasSubstr("--version says numerics 3")));
  EXPECT_THAT(refusal(3, false), AllOf(HasSubstr("is not the model's"), ::testing::Not(HasSubstr("numerics"))));
}

}  // namespace
}  // namespace shearbus::store
