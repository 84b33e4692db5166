// Files of a state directory that are lost, emptied, zeroed, unreadable, damaged or of another directory. A server
// recovers everything, or names the file and refuses, or (without the promise to survive a loss of power) says what is
// lost. It never removes or overwrites a file that it cannot use.
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <optional>

#include "server/store/checkpoint.hpp"
#include "tests/support/store_server.hpp"

namespace shearbus::store {
namespace {

using Call = MemoryStorage::Call;
using Files = std::map<std::string, std::vector<std::byte>>;

Files files_of(MemoryStorage& disk) {
  Files files;
  for (const std::string& name : disk.names()) files[name] = disk.bytes(name);
  return files;
}
MemoryStorage disk_of(const Files& files) {
  MemoryStorage disk;
  for (const auto& [name, bytes] : files) disk.put(name, bytes);
  return disk;
}

// The files of a directory that has seen the requests up to `last`, with a checkpoint after every `each` requests; 0:
// none.
Files written(std::uint64_t last, std::uint64_t each, std::uint8_t id = 1) {
  MemoryStorage disk;
  Server server(disk, Durability::kPower, false, id);
  server.run_to(last, each);
  return files_of(disk);
}

std::string refusal_of(const Files& files, Durability durability) {
  MemoryStorage disk = disk_of(files);
  try {
    Server server(disk, durability);
  } catch (const std::exception& fault) {
    EXPECT_EQ(files_of(disk), files) << "a refused start changes nothing";
    return fault.what();
  }
  return "";
}

void expect_words(const std::string& text, const std::vector<std::string>& words) {
  for (const std::string& word : words) EXPECT_NE(text.find(word), std::string::npos) << word << " in: " << text;
}

TEST(LostFiles, ACheckpointThatCannotBeReadGivesWayToTheOneBeforeAndTheJournal) {
  for (const int code : {EIO, EISDIR, EACCES}) {
    MemoryStorage disk = disk_of(written(20, 6));
    // The first file read is `store`, the second is the newest checkpoint.
    disk.plan({.at_call = 2, .code = code, .for_ever = false, .of = Call::kRead});
    Server server(disk);
    EXPECT_EQ(server.counter.seen, up_to(20));
    expect_words(server.log, {"not loaded"});
    EXPECT_TRUE(disk.exists(checkpoint_name(3)));
  }
}

TEST(LostFiles, AJournalOfTheWholeHistoryReplacesTheOnlyCheckpoint) {
  Files files = written(9, 6);
  files[checkpoint_name(1)][1000] ^= std::byte{4};
  MemoryStorage disk = disk_of(files);
  Server server(disk);
  EXPECT_EQ(server.counter.seen, up_to(9));
  server.checkpoint();
  server.run_to(29, 1);
  EXPECT_EQ(disk.bytes(checkpoint_name(1)), files[checkpoint_name(1)]) << "the damaged file stays as it is";
  EXPECT_EQ(Server(disk).counter.seen, up_to(29));
}

TEST(LostFiles, ACheckpointThatIsMissingIsTold) {
  Files files = written(20, 6);
  files.erase(checkpoint_name(3));
  MemoryStorage disk = disk_of(files);
  Server server(disk);
  EXPECT_EQ(server.counter.seen, up_to(20));
  expect_words(server.log, {"LOST", checkpoint_name(3), "missing"});
}

TEST(LostFiles, WithoutAnyCheckpointAJournalThatBeganLaterIsRefused) {
  Files files = written(20, 6);
  for (const std::uint64_t generation : {2, 3}) files.erase(checkpoint_name(generation));
  for (const auto durability : {Durability::kPower, Durability::kProcess})
    expect_words(refusal_of(files, durability), {segment_name(3), "records from 0 on are missing", "--accept-empty"});
  for (const std::uint64_t number : {3, 4}) files.erase(segment_name(number));
  for (const auto durability : {Durability::kPower, Durability::kProcess})
    expect_words(refusal_of(files, durability), {"no checkpoint can be loaded", "--accept-empty"});
}

// Tries each byte of the last segment (records 18 and 19): the bytes from it to the end are cut off, or set to zero.
TEST(LostFiles, SettledRecordsThatAreLostAtTheEndAreNeverPassedOver) {
  const Files whole = written(20, 6);
  const std::string last = segment_name(4);
  const std::size_t size = whole.at(last).size();
  int lost = 0;
  for (const bool zeroed : {false, true})
    for (std::size_t kept = 0; kept < size; ++kept) {
      Files files = whole;
      std::vector<std::byte>& bytes = files[last];
      bytes.resize(kept);
      if (zeroed) bytes.resize(size);
      if (bytes == whole.at(last)) continue;  // the bytes set to zero were zero before
      const std::string refused = refusal_of(files, Durability::kPower);
      ASSERT_NE(refused, "") << "power: " << kept << " bytes" << zeroed;
      expect_words(refused, {last});
      MemoryStorage disk = disk_of(files);
      try {
        Server server(disk, Durability::kProcess);
        expect_words(server.log, {"LOST: " + last});
        ASSERT_EQ(server.counter.seen, up_to(server.counter.seen.size()));
        ASSERT_GE(server.counter.seen.size(), 18u);
        ++lost;
      } catch (const DamagedFile& fault) {
        EXPECT_TRUE(zeroed) << fault.what();  // only zeros that begin inside a record are damage
      }
      if (HasFailure()) return;
    }
  EXPECT_GT(lost, 200);
}

TEST(LostFiles, ALastSegmentThatIsMissingOrEmptyIsNamedWithWhatItHeld) {
  for (const bool empty : {false, true}) {
    Files files = written(20, 6);
    if (empty)
      files[segment_name(4)].clear();
    else
      files.erase(segment_name(4));
    expect_words(refusal_of(files, Durability::kPower),
                 {segment_name(4), "records from 18 on", empty ? "empty" : "no such file", "--durability process"});
    MemoryStorage disk = disk_of(files);
    {
      Server server(disk, Durability::kProcess);
      EXPECT_EQ(server.counter.seen, up_to(18));
      expect_words(server.log, {"LOST: " + segment_name(4)});
      server.run(19);
    }
    // The loss is accepted once. The file that comes back later holds another history and is refused.
    EXPECT_EQ(Server(disk).counter.seen, up_to(19));
    if (!empty) {
      disk.put(segment_name(4), written(20, 6).at(segment_name(4)));
      expect_words(refusal_of(files_of(disk), Durability::kProcess), {segment_name(5), "two histories"});
    }
  }
}

TEST(LostFiles, AnAcceptedLossCanBeFollowedByPowerAtOnce) {
  Files files = written(20, 6);
  files[segment_name(4)].resize(sizeof(SegmentHeader));
  MemoryStorage disk = disk_of(files);
  EXPECT_EQ(Server(disk, Durability::kProcess).counter.seen, up_to(18));
  EXPECT_EQ(Server(disk, Durability::kPower).counter.seen, up_to(18));
}

TEST(LostFiles, ADirectoryWithoutItsIdIsRefusedOrTold) {
  for (const bool damaged : {false, true}) {
    Files files = written(20, 6);
    if (damaged)
      files[kIdentityName][20] ^= std::byte{1};
    else
      files.erase(kIdentityName);
    expect_words(refusal_of(files, Durability::kPower), {kIdentityName, "--durability process"});
    MemoryStorage disk = disk_of(files);
    {
      Server server(disk, Durability::kProcess, false, 9);
      EXPECT_EQ(server.counter.seen, up_to(20));
      expect_words(server.log, {"LOST: store"});
      server.run(21);
    }
    EXPECT_EQ(Server(disk).counter.seen, up_to(21));
    if (damaged) {
      EXPECT_EQ(disk.bytes(kIdentityName + std::string(".unused")), files[kIdentityName]);
    }
  }
}

TEST(LostFiles, FilesOfAnotherDirectoryAreNamedAndNeitherUsedNorTouched) {
  const Files foreign = written(40, 6, 2);
  Files files = written(20, 6);
  // Puts a newer checkpoint and a later segment of the other directory into this one. The server will itself want to
  // write files with these names.
  const std::vector<std::string> names = {checkpoint_name(6), segment_name(7)};
  for (const std::string& name : names) files[name] = foreign.at(name);
  for (const auto durability : {Durability::kPower, Durability::kProcess}) {
    MemoryStorage disk = disk_of(files);
    {
      Server server(disk, durability);
      EXPECT_EQ(server.counter.seen, up_to(20));
      for (const std::string& name : names) expect_words(server.log, {"FOREIGN: " + name});
      server.run_to(60, 6);
    }
    for (const std::string& name : names) EXPECT_EQ(disk.bytes(name), foreign.at(name)) << name;
    EXPECT_EQ(Server(disk, durability).counter.seen, up_to(60));
  }
}

TEST(LostFiles, AForeignSegmentInPlaceOfTheLastOneIsALoss) {
  Files files = written(20, 6);
  files[segment_name(4)] = written(20, 6, 2).at(segment_name(4));
  expect_words(refusal_of(files, Durability::kPower), {segment_name(4)});
}

TEST(LostFiles, StrayFilesAreLeftAloneAndStopNothing) {
  Files files = written(20, 6);
  const std::vector<std::byte> text(100, std::byte{'x'});
  const std::vector<std::string> strays = {"journal-7.log", "journal-000000000099.log", "checkpoint-3.h5",
                                           "notes.tmp",     "journal-999999999999.log", "checkpoint-000000000099.h5",
                                           "notes"};
  for (const std::string& name : strays) files[name] = text;
  MemoryStorage disk = disk_of(files);
  {
    Server server(disk);
    EXPECT_EQ(server.counter.seen, up_to(20));
    expect_words(server.log, {"journal-7.log", "journal-000000000099.log", "checkpoint-3.h5"});
    server.run_to(40, 6);
  }
  for (const std::string& name : strays) EXPECT_EQ(disk.bytes(name), text) << name;
  EXPECT_EQ(Server(disk).counter.seen, up_to(40));
}

TEST(LostFiles, AFaultBeforeWhatTheCheckpointHoldsStopsNothing) {
  Files files = written(20, 6);  // segment 3 holds the records 12 to 17, which the newest checkpoint includes
  files[segment_name(3)][100] ^= std::byte{1};
  MemoryStorage disk = disk_of(files);
  Server server(disk);
  EXPECT_EQ(server.counter.seen, up_to(20));
  expect_words(server.log, {segment_name(3), "the other files hold its records"});
}

TEST(LostFiles, SettingAsideTwiceKeepsBoth) {
  MemoryStorage disk;
  std::vector<Files> before;
  for (int round = 0; round < 3; ++round) {
    Server(disk).run_to(3);
    disk.bytes(segment_name(1))[100] ^= std::byte{1};
    before.push_back(files_of(disk));
    Server empty(disk, Durability::kPower, true);
    EXPECT_TRUE(empty.counter.seen.empty());
  }
  for (std::size_t round = 0; round < before.size(); ++round) {
    const std::string suffix = round == 0 ? ".unused" : ".unused-" + std::to_string(round + 1);
    for (const std::string& name : {segment_name(1), std::string(kIdentityName)}) {
      ASSERT_TRUE(disk.exists(name + suffix)) << name << suffix;
      EXPECT_EQ(disk.bytes(name + suffix), before[round].at(name)) << suffix;
    }
  }
}

TEST(LostFiles, IdleStartsLeaveNoSegment) {
  MemoryStorage disk;
  for (int start = 0; start < 5; ++start) Server server(disk);
  EXPECT_EQ(disk.names(), std::vector<std::string>{kIdentityName});
  { Server(disk).run(1); }
  const auto names = disk.names();
  for (int start = 0; start < 5; ++start) EXPECT_EQ(Server(disk).counter.seen, up_to(1));
  EXPECT_EQ(disk.names(), names);
}

TEST(LostFiles, ASegmentOfTheLargestSizeAllowedIsContinuedInAnother) {
  MemoryStorage disk;
  {
    Server server(disk);
    server.run(1);
    server.run(2);
    disk.plan({.at_call = 1, .code = EFBIG, .for_ever = false, .of = Call::kAppend});
    server.run(3);
    disk.heal();
    server.run(4);
  }
  EXPECT_TRUE(disk.exists(segment_name(2)));
  EXPECT_EQ(Server(disk).counter.seen, up_to(4));
}

// The record that is not settled yet when its segment ends, for a checkpoint or for its size.
TEST(LostFiles, ASegmentIsDurableBeforeAnotherFollowsIt) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    for (const bool for_checkpoint : {true, false}) {
      SCOPED_TRACE(for_checkpoint ? "checkpoint" : "size");
      MemoryStorage disk;
      {
        Server server(disk);
        server.run(1);
        ASSERT_TRUE(server.checkpoint());
        server.append(2);
        if (for_checkpoint) {
          ASSERT_TRUE(server.checkpoint());
        } else {
          server.append(3);
          disk.plan({.at_call = 1, .code = EFBIG, .for_ever = false, .of = Call::kAppend});
          server.append(4);
          disk.heal();
        }
        server.run(server.counter.seen.back() + 1);
      }
      disk.die_of_power(random);
      if (for_checkpoint) disk.bytes(checkpoint_name(2))[200] ^= std::byte{1};
      std::optional<Server> again;
      ASSERT_NO_THROW(again.emplace(disk));
      EXPECT_EQ(again->counter.seen, up_to(for_checkpoint ? 3 : 5));
    }
  }
}

TEST(LostFiles, SegmentsThatCouldNotBeStartedLeaveNothing) {
  MemoryStorage disk;
  Server server(disk);
  const auto names = disk.names();
  for (const std::uint64_t n : {1, 2}) {  // append 1: the segment's header; 2: the file `store`, which names it
    disk.plan({.at_call = n, .code = ENOSPC, .for_ever = true, .of = Call::kAppend});
    EXPECT_THROW(server.run(1), StorageError);
    EXPECT_FALSE(server.store.failed());
    EXPECT_EQ(disk.names(), names);
    disk.heal();
  }
  server.run(1);
  EXPECT_EQ(Server(disk).counter.seen, up_to(server.counter.seen.size()));
}

TEST(LostFiles, ACapsuleThatFoundNoRoomLeavesNothingInTheWayOfTheNext) {
  MemoryStorage disk;
  Server server(disk);
  const auto names = disk.names();
  disk.plan({.at_call = 1, .code = ENOSPC, .for_ever = false, .of = Call::kAppend});
  EXPECT_THROW(server.store.leave_capsule({}), StorageError);
  disk.heal();
  EXPECT_EQ(disk.names(), names);
  EXPECT_TRUE(disk.exists(server.store.leave_capsule({})));
}

}  // namespace
}  // namespace shearbus::store
