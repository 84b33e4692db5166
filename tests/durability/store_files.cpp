// The bytes of checkpoints and journals: a reader must return what was written, and must refuse all other bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>

#include "server/store/checkpoint.hpp"
#include "server/store/journal.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::store {
namespace {

using support::said_by;
using testing::AllOf;
using testing::HasSubstr;

std::vector<std::byte> some_bytes(std::size_t size, int seed) {
  std::vector<std::byte> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::byte>(seed + 31 * static_cast<int>(i));
  return bytes;
}

shard::States small_states(std::vector<std::uint32_t> slots, double first) {
  shard::States states{.rows = std::move(slots), .columns = {}};
  const std::size_t rows = states.rows.size();
  for (const auto& [name, units, width] : {std::tuple{"temperature_k", "K", 3}, {"shear_stress_pa", "Pa", 1}}) {
    std::vector<double> values(rows * static_cast<std::size_t>(width));
    std::iota(values.begin(), values.end(), first);
    states.columns.push_back({name, units, static_cast<std::size_t>(width), std::move(values)});
  }
  return states;
}

Snapshot small_snapshot() {
  Snapshot snapshot{.next_index = 42, .server_version = "0.1.0", .sessions = {}};
  SessionImage closed;
  closed.id.fill(0xfe);
  closed.open = false;
  closed.identity = "uid 7";
  closed.last_sequence = 9;
  closed.last_hash = 77;
  closed.reply_header = some_bytes(20, 1);
  SessionImage open;
  open.identity = "key abc";
  open.scene = "name = \"small\"\n";
  open.requests = 6;
  open.node_steps = 12;
  open.solver_ns = 1234;
  open.last_sequence = 5;
  open.last_hash = ~0ULL;
  open.reply_header = some_bytes(31, 2);
  open.reply_payload = some_bytes(48, 3);
  open.node_ids = {7, 1ULL << 63};
  open.state_version = 4;
  open.committed = small_states({0, 1}, 300.0);
  open.trial = small_states({1}, 400.0);
  open.marks = {
      {.name = "dump", .state_version = 2, .node_ids = {7, 1ULL << 63}, .states = small_states({0, 1}, 350.0)}};
  open.id.fill(0x01);
  snapshot.sessions = {closed, open};
  return snapshot;
}

// Flips each bit of a file.
template <class Read>
void expect_every_flip_damages(std::vector<std::byte> bytes, const Read& read) {
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    const auto mask = static_cast<std::byte>(1 << (bit % 8));
    bytes[bit / 8] ^= mask;
    ASSERT_THROW(read(bytes), DamagedFile) << "bit " << bit;
    bytes[bit / 8] ^= mask;
  }
}

bool same(const shard::States& a, const shard::States& b) {
  return a.rows == b.rows && std::equal(a.columns.begin(), a.columns.end(), b.columns.begin(), b.columns.end(),
                                        [](const shard::StateColumn& x, const shard::StateColumn& y) {
                                          return x.name == y.name && x.units == y.units && x.width == y.width &&
                                                 x.values == y.values;
                                        });
}

TEST(Checkpoint, ComesBackAsItWent) {
  const Snapshot snapshot = small_snapshot();
  const auto bytes = checkpoint_bytes(snapshot, 3);
  const Snapshot back = read_checkpoint(bytes, "file", 3);
  EXPECT_EQ(back.next_index, 42u);
  EXPECT_EQ(back.server_version, "0.1.0");
  ASSERT_EQ(back.sessions.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const SessionImage &a = snapshot.sessions[i], &b = back.sessions[i];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.open, b.open);
    EXPECT_EQ(a.identity, b.identity);
    EXPECT_EQ(a.last_sequence, b.last_sequence);
    EXPECT_EQ(a.last_hash, b.last_hash);
    EXPECT_EQ(a.reply_header, b.reply_header);
    EXPECT_EQ(a.reply_payload, b.reply_payload);
    EXPECT_EQ(a.requests, b.requests);
    EXPECT_EQ(a.node_steps, b.node_steps);
    EXPECT_EQ(a.solver_ns, b.solver_ns);
    EXPECT_EQ(a.scene, b.scene);
    EXPECT_EQ(a.node_ids, b.node_ids);
    EXPECT_EQ(a.state_version, b.state_version);
    EXPECT_TRUE(same(a.committed, b.committed));
    ASSERT_EQ(a.marks.size(), b.marks.size());
    for (std::size_t m = 0; m < a.marks.size(); ++m) {
      EXPECT_EQ(a.marks[m].name, b.marks[m].name);
      EXPECT_EQ(a.marks[m].state_version, b.marks[m].state_version);
      EXPECT_TRUE(same(a.marks[m].states, b.marks[m].states));
    }
    ASSERT_EQ(a.trial.has_value(), b.trial.has_value());
    if (a.trial) {
      EXPECT_TRUE(same(*a.trial, *b.trial));
    }
  }
}

// The reply to the part before the last one, which a client may lack, too.
TEST(Checkpoint, TheReplyToAPartBeforeComesBackAndNeedsAPlaceBefore) {
  Snapshot snapshot = small_snapshot();
  SessionImage& session = snapshot.sessions[1];
  session.before_hash = 1234;
  session.before_header = some_bytes(17, 5);
  session.before_payload = some_bytes(64, 6);
  const auto bytes = checkpoint_bytes(snapshot, 3);
  const SessionImage back = read_checkpoint(bytes, "file", 3).sessions[1];
  EXPECT_EQ(back.before_hash, session.before_hash);
  EXPECT_EQ(back.before_header, session.before_header);
  EXPECT_EQ(back.before_payload, session.before_payload);
  EXPECT_TRUE(read_checkpoint(checkpoint_bytes(small_snapshot(), 3), "file", 3).sessions[1].before_header.empty());
  for (const std::uint64_t first : {0, 1}) {
    session.last_sequence = first;
    EXPECT_ANY_THROW(read_checkpoint(checkpoint_bytes(snapshot, 3), "file", 3)) << first;
  }
}

TEST(Checkpoint, SameSnapshotIsTheSameBytes) {
  EXPECT_EQ(checkpoint_bytes(small_snapshot(), 3), checkpoint_bytes(small_snapshot(), 3));
}

TEST(Checkpoint, EveryBitFlipIsRefused) {
  const auto bytes = checkpoint_bytes(small_snapshot(), 3);
  expect_every_flip_damages(bytes, [](Bytes flipped) { verified_image(flipped, "file", 3); });
  EXPECT_NO_THROW(read_checkpoint(bytes, "file", 3));
  RecordProperty("flips", static_cast<int>(8 * bytes.size()));
}

TEST(Checkpoint, EveryTruncationIsRefused) {
  const auto bytes = checkpoint_bytes(small_snapshot(), 3);
  for (std::size_t size = 0; size < bytes.size(); ++size)
    ASSERT_THROW(verified_image(Bytes(bytes).first(size), "file", 3), DamagedFile) << size << " bytes";
}

// HDF5 looks for a file of the same name on the disk even if it opens a file in memory. A file of this name must have
// no effect.
TEST(Checkpoint, NoFileOfTheWorkingDirectoryIsTakenForItNorStandsInItsWay) {
  const test::Scratch scratch;
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(scratch.path());
  for (const char* name : {"checkpoint", "checkpoint.h5"}) std::ofstream(name) << "something else";
  const auto bytes = checkpoint_bytes(small_snapshot(), 3);
  EXPECT_NO_THROW(read_checkpoint(bytes, "file", 3));
  std::filesystem::current_path(before);
}

TEST(Checkpoint, AnotherGenerationUnderItsNameIsRefused) {
  EXPECT_THROW(read_checkpoint(checkpoint_bytes(small_snapshot(), 3), "file", 4), DamagedFile);
}

TEST(Checkpoint, StatesAndPartsOfOtherNodesThanTheSessionsAreRefused) {
  const auto refusal = [](const auto& change) -> std::string {
    Snapshot snapshot = small_snapshot();
    change(snapshot);
    return said_by<DamagedFile>([&] { read_checkpoint(checkpoint_bytes(snapshot, 3), "file", 3); });
  };
  for (const std::vector<std::uint32_t>& rows : {std::vector<std::uint32_t>{0, 3533880}, {1, 0}, {0, 0}, {0}}) {
    EXPECT_THAT(refusal([&](Snapshot& s) { s.sessions[1].committed = small_states(rows, 300.0); }),
                HasSubstr("slots of all 2 nodes in their order in committed"));
    EXPECT_THAT(refusal([&](Snapshot& s) { s.sessions[1].marks[0].states = small_states(rows, 300.0); }),
                HasSubstr("slots of all 2 nodes in their order in states"));
    EXPECT_THAT(refusal([&](Snapshot& s) {
                  s.transfers.push_back({.node_ids = {8, 9}, .states = small_states(rows, 300.0)});
                }),
                HasSubstr("slots of all 2 nodes in their order in states"));
  }
  const auto parts = [](std::vector<std::uint32_t> rows) {
    return [rows = std::move(rows)](Snapshot& s) {
      s.sessions[1].part_header = some_bytes(8, 1);
      s.sessions[1].part_rows = rows;
    };
  };
  EXPECT_THAT(refusal(parts({0, 2})), HasSubstr("find node 2 of part_rows"));
  EXPECT_EQ(refusal(parts({1})), "");
}

struct Journal {
  Journal() {
    JournalWriter writer(disk, segment_name(7), {.number = 7, .epoch = 99, .first_index = 100}, true);
    for (int i = 0; i < 4; ++i) {
      headers.push_back(some_bytes(20 + static_cast<std::size_t>(i), i));
      payloads.push_back(i == 2 ? std::vector<std::byte>() : std::vector<std::byte>(64, std::byte{0}));
      Record record{.sequence = static_cast<std::uint64_t>(i),
                    .previous_reply = 5,
                    .header_frame = headers.back(),
                    .payload_frame = payloads.back(),
                    .identity = i == 0 ? "uid 1000" : ""};
      record.session.fill(static_cast<std::uint8_t>(i));
      ends.push_back(writer.bytes());
      writer.append(record);
    }
    ends.push_back(writer.bytes());
    bytes = disk.bytes(segment_name(7));
  }
  support::MemoryStorage disk;
  std::vector<std::vector<std::byte>> headers, payloads;
  std::vector<std::uint64_t> ends;  // position in `bytes` of the end of the header and of each record
  std::vector<std::byte> bytes;
};

TEST(Journal, ComesBackAsItWent) {
  const Journal journal;
  const Segment segment = read_segment(journal.bytes, "file");
  EXPECT_EQ(segment.number, 7u);
  EXPECT_EQ(segment.epoch, 99u);
  EXPECT_EQ(segment.first_index, 100u);
  EXPECT_EQ(segment.next_index(), 104u);
  EXPECT_FALSE(segment.torn);
  EXPECT_EQ(segment.sound_bytes, journal.bytes.size());
  for (std::size_t i = 0; i < 4; ++i) {
    const Record& record = segment.records[i];
    EXPECT_EQ(record.index, 100 + i);
    EXPECT_EQ(record.sequence, i);
    EXPECT_EQ(record.session[3], i);
    EXPECT_EQ(record.identity, i == 0 ? "uid 1000" : "");
    EXPECT_TRUE(std::equal(record.header_frame.begin(), record.header_frame.end(), journal.headers[i].begin(),
                           journal.headers[i].end()));
    EXPECT_TRUE(std::equal(record.payload_frame.begin(), record.payload_frame.end(), journal.payloads[i].begin(),
                           journal.payloads[i].end()));
  }
}

TEST(Journal, EveryBitFlipIsAnErrorAndNeverATornTail) {
  expect_every_flip_damages(Journal().bytes, [](Bytes flipped) { read_segment(flipped, "file"); });
}

TEST(Journal, TruncationAnywhereCutsTheTornRecordOnly) {
  const Journal journal;
  for (std::size_t size = 0; size <= journal.bytes.size(); ++size) {
    const Segment segment = read_segment(Bytes(journal.bytes).first(size), "file");
    if (size < sizeof(SegmentHeader)) {
      EXPECT_EQ(segment.sound_bytes, 0u);
      continue;
    }
    std::size_t whole = 0;
    while (whole < 4 && journal.ends[whole + 1] <= size) ++whole;
    ASSERT_EQ(segment.records.size(), whole) << size << " bytes";
    ASSERT_EQ(segment.sound_bytes, journal.ends[whole]);
    ASSERT_EQ(segment.torn, size != journal.ends[whole]);
  }
}

TEST(Journal, AFileMadeLongerBeforeItsDataCameIsTorn) {
  const Journal journal;
  for (const std::size_t zeros : {1u, 8u, 500u, 5000u}) {
    auto bytes = journal.bytes;
    bytes.resize(bytes.size() + zeros);
    const Segment segment = read_segment(bytes, "file");
    EXPECT_EQ(segment.records.size(), 4u);
    EXPECT_TRUE(segment.torn);
  }
  auto bytes = journal.bytes;
  // as if the last bytes of the record had not reached the disk
  std::fill(bytes.end() - 16, bytes.end(), std::byte{0});
  EXPECT_EQ(read_segment(bytes, "file").records.size(), 3u);
}

TEST(Journal, DamageBeforeTheLastRecordIsAnErrorEvenInZeros) {
  const Journal journal;
  auto bytes = journal.bytes;
  std::fill(bytes.begin() + static_cast<std::ptrdiff_t>(journal.ends[1]),
            bytes.begin() + static_cast<std::ptrdiff_t>(journal.ends[2]), std::byte{0});
  EXPECT_THROW(read_segment(bytes, "file"), DamagedFile);
}

// Writes other versions to a place in the bytes of a file whose version is `ours`.
template <class Version, class Read>
void expect_other_versions_are_named(std::vector<std::byte> bytes, std::size_t at, Version ours, const Read& read) {
  auto swapped = std::bit_cast<std::array<std::byte, sizeof ours>>(ours);
  std::ranges::reverse(swapped);
  for (const Version other :
       {static_cast<Version>(ours - 1), static_cast<Version>(ours + 1), std::bit_cast<Version>(swapped)}) {
    std::memcpy(bytes.data() + at, &other, sizeof other);
    EXPECT_THAT(said_by<DamagedFile>([&] { read(bytes); }), AllOf(HasSubstr("version " + std::to_string(other)),
                                                                  HasSubstr("reads version " + std::to_string(ours))));
  }
}

TEST(StoreFiles, OfAnotherVersionOrByteOrderAreRefusedByName) {
  const auto checkpoint = checkpoint_bytes(small_snapshot(), 3);
  expect_other_versions_are_named(checkpoint,
                                  checkpoint.size() - sizeof(CheckpointFooter) + offsetof(CheckpointFooter, version),
                                  CheckpointFooter{}.version, [](Bytes bytes) { read_checkpoint(bytes, "file", 3); });
  expect_other_versions_are_named(Journal().bytes, offsetof(SegmentHeader, version), SegmentHeader{}.version,
                                  [](Bytes bytes) { read_segment(bytes, "file"); });
}

}  // namespace
}  // namespace shearbus::store
