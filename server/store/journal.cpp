#include "server/store/journal.hpp"

#include <fmt/format.h>

#include <array>
#include <cstring>

#include "proto/files/record_file.hpp"

namespace shearbus::store {
namespace {

using files::bytes_of;
using files::sum_of_header;

using FileRecord = files::FileRecord<RecordHeader, 3>;  // identity, header frame, payload frame

std::uint64_t sum_of_settled(std::uint64_t settled, std::uint64_t header_sum) {
  return files::sum_of(std::array{bytes_of(settled)}, header_sum);
}

// The bytes of a segment that have not been read yet.
struct Rest {
  Bytes bytes;
  Bytes take(std::size_t count) {
    const Bytes taken = bytes.first(std::min(count, bytes.size()));
    bytes = bytes.subspan(taken.size());
    return taken;
  }
};

[[noreturn]] void damaged(const std::string& name, std::uint64_t offset, const std::string& what) {
  throw DamagedFile(fmt::format("{}, byte {}: {}", name, offset, what));
}

// Returns false if the header is incomplete: the file is too short, or all its bytes are 0.
bool read_segment_header(Bytes bytes, const std::string& name, Segment& segment) {
  SegmentHeader& header = segment;
  if (bytes.size() < sizeof header || files::all_zero(bytes)) return false;
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.magic != kJournalMagic) damaged(name, 0, "not a journal: it does not begin with the journal's mark");
  if (header.version != kJournalVersion)
    damaged(
        name, 0,
        fmt::format("journal version {}; this server reads version {}. Finish the run with the server that wrote it",
                    header.version, kJournalVersion));
  if (header.sum != sum_of_header(header) || header.header_bytes != sizeof header)
    damaged(name, 0, "the segment's header does not match its sum");
  if (header.settled_sum != sum_of_settled(header.settled, header.sum))
    damaged(name, offsetof(SegmentHeader, settled), "the number of settled records does not match its sum");
  return true;
}

// Reads the record at segment.sound_bytes. Returns false at the end of the file and for an incomplete record.
bool read_record(Bytes bytes, const std::string& name, Segment& segment) {
  Rest rest{bytes.subspan(segment.sound_bytes)};
  FileRecord record;
  segment.torn = !rest.bytes.empty();
  if (!record.read(rest, segment.next_index(), kMaxFrameBytes,
                   [&](const std::string& what) { damaged(name, segment.sound_bytes, what); }))
    return false;
  const auto& [identity, header_frame, payload_frame] = record.parts;
  segment.records.push_back({.session = record.header.session,
                             .sequence = record.header.sequence,
                             .previous_reply = record.header.previous_reply,
                             .header_frame = header_frame,
                             .payload_frame = payload_frame,
                             .identity = {reinterpret_cast<const char*>(identity.data()), identity.size()},
                             .index = record.header.index});
  segment.sound_bytes = bytes.size() - rest.bytes.size();
  segment.torn = false;
  return true;
}

}  // namespace

JournalWriter::JournalWriter(Storage& storage, const std::string& name, SegmentHeader header, bool durable)
    : file_(storage.create(name)),
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
  FileRecord written{.header = {.index = next_index_,
                                .session = record.session,
                                .sequence = record.sequence,
                                .previous_reply = record.previous_reply,
                                .header_frame_bytes = static_cast<std::uint32_t>(record.header_frame.size()),
                                .payload_frame_bytes = static_cast<std::uint32_t>(record.payload_frame.size()),
                                .identity_bytes = static_cast<std::uint32_t>(record.identity.size())},
                     .parts = {std::as_bytes(std::span(record.identity)), record.header_frame, record.payload_frame}};
  const auto parts = written.sealed();
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
