// The journal holds one record for each request that changed a session, in the order of execution. Replaying it from
// the same states gives the same states and replies, so the journal defines the states between two checkpoints.
// FORMAT.md describes the bytes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/format.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

// A request as it arrived. A record read from a file points into the bytes of the file. A record without a header frame
// is a proof: it holds only the hash of the session's last reply.
struct Record {
  SessionKey session{};
  std::uint64_t sequence = 0;
  std::uint64_t previous_reply = 0;
  Bytes header_frame;
  Bytes payload_frame;        // empty: the request has no payload frame
  std::string_view identity;  // open_session only: the owner of the session
  std::uint64_t index = 0;    // number of the record, assigned by the journal
};

// Appends records to a new segment, which is one file of the journal.
class JournalWriter {
 public:
  // Creates the file, with the numbers, epoch, id and numerics of `header`. With `durable` the name and the header are on
  // the disk when the constructor returns. A file that cannot be finished is removed.
  JournalWriter(Storage& storage, const std::string& name, SegmentHeader header, bool durable);

  // Throws StorageError. If no_space() is true the file is unchanged and the call may be repeated; after any other
  // failure the journal must not be used.
  void append(const Record& record);
  // Must be called before the requests of the appended records are answered. Calls File::sync if the journal is
  // durable, then notes in the segment's header which records are settled: all appended ones. Does nothing if no record
  // was appended since the last call. A failure is final.
  void settle();

  std::uint64_t next_index() const { return next_index_; }
  std::uint64_t first_index() const { return first_index_; }
  std::uint64_t bytes() const { return bytes_; }
  bool broken() const { return broken_; }

 private:
  std::unique_ptr<File> file_;
  std::uint64_t first_index_;
  std::uint64_t next_index_;
  std::uint64_t bytes_ = 0;
  std::uint64_t header_sum_ = 0;
  bool durable_;
  bool unsettled_ = false;
  bool broken_ = false;
};

// The contents of a segment (one file of the journal). `records` point into the bytes that the segment was read from.
struct Segment : SegmentHeader {
  std::vector<Record> records;
  std::uint64_t sound_bytes = 0;  // bytes up to the end of the last complete record; 0: the header is incomplete
  bool torn = false;              // true if the last record is incomplete; its request was then never answered

  std::uint64_t next_index() const { return first_index + records.size(); }
};

// Reads a segment. An incomplete last record is no damage: the writer may have died while it appended the record.
// Throws DamagedFile for any other fault of the bytes.
Segment read_segment(Bytes bytes, const std::string& name);

}  // namespace shearbus::store
