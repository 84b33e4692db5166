// The journal: every request that changed a session, in the order they were run, one record each. Replaying it on the
// same states gives the same states and replies, so it is the truth between two checkpoints. FORMAT.md tells the bytes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/format.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

// A request as it arrived. Where it was read from a file it points into the file's bytes.
struct Record {
  SessionKey session{};
  std::uint64_t sequence = 0;
  std::uint64_t previous_reply = 0;
  Bytes header_frame;
  Bytes payload_frame;        // empty: there was none
  std::string_view identity;  // of an opening: who the session belongs to
  std::uint64_t index = 0;    // given by the journal
};

// The segment being written.
class JournalWriter {
 public:
  // Makes the file; with `durable` its name and header have reached the disk when this returns.
  JournalWriter(Storage& storage, std::uint64_t number, std::uint64_t epoch, std::uint64_t first_index, bool durable);

  // Throws StorageError: where it says no_space(), the file is as before and the call may be made again; any other
  // failure leaves the journal broken.
  void append(const Record& record);
  void sync();  // as File::sync; does nothing where nothing was appended since

  std::uint64_t number() const { return number_; }
  std::uint64_t next_index() const { return next_index_; }
  std::uint64_t first_index() const { return first_index_; }
  std::uint64_t bytes() const { return bytes_; }
  bool broken() const { return broken_; }

 private:
  std::unique_ptr<File> file_;
  std::uint64_t number_;
  std::uint64_t first_index_;
  std::uint64_t next_index_;
  std::uint64_t bytes_ = 0;
  bool unsynced_ = false;
  bool broken_ = false;
};

// A segment as found. `records` point into the bytes it was read from.
struct Segment {
  std::uint64_t number = 0;
  std::uint64_t epoch = 0;
  std::uint64_t first_index = 0;
  std::vector<Record> records;
  std::uint64_t sound_bytes = 0;  // up to the end of the last whole record; 0: not even the segment's header is whole
  bool torn = false;              // a record was begun and not finished: its request was never answered

  std::uint64_t next_index() const { return first_index + records.size(); }
};

// Throws DamagedFile for anything a writer that died while appending cannot have left.
Segment read_segment(Bytes bytes, const std::string& name);

}  // namespace shearbus::store
