#include "server/store/journal.hpp"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace shearbus::store {
namespace {

// A stored sum is never 0, so that it differs from the parts of a file that were never written, which read as 0.
std::uint64_t never_zero(std::uint64_t sum) {
  return sum != 0 ? sum : 1;
}

template <typename Header>
std::uint64_t sum_of_header(const Header& header) {
  return never_zero(XXH3_64bits(&header, offsetof(Header, sum)));
}

std::uint64_t sum_of_settled(std::uint64_t settled, std::uint64_t header_sum) {
  return never_zero(XXH3_64bits_withSeed(&settled, sizeof settled, header_sum));
}

// The sum of each part is the seed of the next part's sum.
std::uint64_t sum_of_record(const RecordHeader& header, Bytes identity, Bytes header_frame, Bytes payload_frame) {
  std::uint64_t sum = XXH3_64bits(&header, sizeof header);
  for (const Bytes part : {identity, header_frame, payload_frame})
    sum = XXH3_64bits_withSeed(part.data(), part.size(), sum);
  return never_zero(sum);
}

template <typename Value>
Bytes bytes_of(const Value& value) {
  return std::as_bytes(std::span(&value, 1));
}

template <typename Value>
Value value_at(Bytes bytes, std::uint64_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

bool all_zero(Bytes bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](std::byte byte) { return byte == std::byte{0}; });
}

[[noreturn]] void damaged(const std::string& name, std::uint64_t offset, const std::string& what) {
  throw DamagedFile(name + ", byte " + std::to_string(offset) + ": " + what);
}

// Returns false if the header is incomplete: the file is too short, or all its bytes are 0.
bool read_segment_header(Bytes bytes, const std::string& name, Segment& segment) {
  if (bytes.size() < sizeof(SegmentHeader) || all_zero(bytes)) return false;
  const auto header = value_at<SegmentHeader>(bytes, 0);
  if (header.magic != kJournalMagic) damaged(name, 0, "not a journal: it does not begin with the journal's mark");
  if (header.version != kJournalVersion)
    damaged(name, 0,
            "journal version " + std::to_string(header.version) + "; this server reads version " +
                std::to_string(kJournalVersion) + ". Finish the run with the server that wrote it");
  if (header.sum != sum_of_header(header) || header.header_bytes != sizeof header)
    damaged(name, 0, "the segment's header does not match its sum");
  if (header.settled_sum != sum_of_settled(header.settled, header.sum))
    damaged(name, offsetof(SegmentHeader, settled), "the number of settled records does not match its sum");
  segment.number = header.number;
  segment.epoch = header.epoch;
  segment.first_index = header.first_index;
  segment.store = header.store;
  segment.settled = header.settled;
  segment.numerics = header.numerics;
  return true;
}

// Reads the record at segment.sound_bytes. Returns false at the end of the file and for an incomplete record.
bool read_record(Bytes bytes, const std::string& name, Segment& segment) {
  const std::uint64_t offset = segment.sound_bytes;
  const Bytes rest = bytes.subspan(offset);
  segment.torn = !rest.empty();
  if (rest.size() < sizeof(RecordHeader) || all_zero(rest)) return false;
  const auto header = value_at<RecordHeader>(rest, 0);
  if (header.sum != sum_of_header(header)) damaged(name, offset, "the header of a record does not match its sum");
  if (header.index != segment.next_index())
    damaged(name, offset,
            "record " + std::to_string(header.index) + " where " + std::to_string(segment.next_index()) + " should be");
  if (header.header_frame_bytes > kMaxFrameBytes || header.payload_frame_bytes > kMaxFrameBytes ||
      header.identity_bytes > kMaxFrameBytes)
    damaged(name, offset, "a record longer than any request");
  const std::uint64_t frames_at = sizeof header + header.identity_bytes;
  const std::uint64_t length = frames_at + header.header_frame_bytes + header.payload_frame_bytes;
  if (rest.size() < length + kRecordSumBytes) return false;
  const auto sum = value_at<std::uint64_t>(rest, length);
  // If the length of a file reached the disk before its data, the file ends in zeros. A stored sum is never zero.
  if (sum == 0 && rest.size() == length + kRecordSumBytes) return false;
  const Bytes identity = rest.subspan(sizeof header, header.identity_bytes);
  const Bytes header_frame = rest.subspan(frames_at, header.header_frame_bytes);
  const Bytes payload_frame = rest.subspan(frames_at + header.header_frame_bytes, header.payload_frame_bytes);
  if (sum != sum_of_record(header, identity, header_frame, payload_frame))
    damaged(name, offset, "record " + std::to_string(header.index) + " does not match its sum");
  segment.records.push_back({.session = header.session,
                             .sequence = header.sequence,
                             .previous_reply = header.previous_reply,
                             .header_frame = header_frame,
                             .payload_frame = payload_frame,
                             .identity = {reinterpret_cast<const char*>(identity.data()), identity.size()},
                             .index = header.index});
  segment.sound_bytes = offset + length + kRecordSumBytes;
  segment.torn = false;
  return true;
}

}  // namespace

JournalWriter::JournalWriter(Storage& storage, std::uint64_t number, std::uint64_t epoch, std::uint64_t first_index,
                             bool durable, const StoreId& store, std::uint16_t numerics)
    : JournalWriter(
          storage, segment_name(number),
          {.numerics = numerics, .number = number, .epoch = epoch, .first_index = first_index, .store = store},
          durable) {}

JournalWriter::JournalWriter(Storage& storage, const std::string& name, SegmentHeader header, bool durable)
    : file_(storage.create(name)),
      number_(header.number),
      first_index_(header.first_index),
      next_index_(header.first_index),
      durable_(durable) {
  header.sum = header_sum_ = sum_of_header(header);
  header.settled = header.first_index;
  header.settled_sum = sum_of_settled(header.settled, header.sum);
  const std::array parts = {bytes_of(header)};
  bytes_ = sizeof header;
  try {
    file_->append(parts);
    if (!durable) return;
    file_->sync();
    storage.sync_directory();
  } catch (const std::exception&) {
    discard(storage, name);
    throw;
  }
}

void JournalWriter::append(const Record& record) {
  if (broken_) throw StorageError("the journal is broken", EIO);
  RecordHeader header{.index = next_index_,
                      .session = record.session,
                      .sequence = record.sequence,
                      .previous_reply = record.previous_reply,
                      .header_frame_bytes = static_cast<std::uint32_t>(record.header_frame.size()),
                      .payload_frame_bytes = static_cast<std::uint32_t>(record.payload_frame.size()),
                      .identity_bytes = static_cast<std::uint32_t>(record.identity.size())};
  header.sum = sum_of_header(header);
  const Bytes identity = std::as_bytes(std::span(record.identity));
  const std::uint64_t sum = sum_of_record(header, identity, record.header_frame, record.payload_frame);
  const std::array parts = {bytes_of(header), identity, record.header_frame, record.payload_frame, bytes_of(sum)};
  try {
    file_->append(parts);
  } catch (const StorageError& fault) {
    broken_ = true;
    if (!fault.no_space()) throw;
    file_->truncate(bytes_);  // removes the written part of the incomplete record
    broken_ = false;
    throw;
  }
  for (const Bytes part : parts) bytes_ += part.size();
  ++next_index_;
  unsettled_ = true;
}

void JournalWriter::settle() {
  if (broken_) throw StorageError("the journal is broken", EIO);
  if (!unsettled_) return;
  broken_ = true;
  if (durable_) file_->sync();
  // The index of the first unsettled record is written after the sync, so no disk can hold the index without the
  // records before it. The next sync brings the index to the disk.
  const std::array<std::uint64_t, 2> note = {next_index_, sum_of_settled(next_index_, header_sum_)};
  try {
    file_->overwrite(offsetof(SegmentHeader, settled), bytes_of(note));
  } catch (const StorageError& fault) {
    if (!fault.no_space()) throw;  // the header keeps its older index of an unsettled record, still valid
  }
  broken_ = false;
  unsettled_ = false;
}

Segment read_segment(Bytes bytes, const std::string& name) {
  Segment segment;
  if (!read_segment_header(bytes, name, segment)) {
    segment.torn = true;
    return segment;
  }
  segment.sound_bytes = sizeof(SegmentHeader);
  while (read_record(bytes, name, segment)) {
  }
  return segment;
}

}  // namespace shearbus::store
