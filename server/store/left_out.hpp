// Sessions and records that an operator leaves out of a recovery. What is left out is set aside in files of its own.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/store/journal.hpp"
#include "server/store/snapshot.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

struct LeaveOut {
  std::vector<std::string> sessions;   // first digits of ids of sessions, at least 8
  std::vector<std::uint64_t> records;  // records of the journal; the later records of their sessions go with them
};

class LeftOut {
 public:
  // Throws std::invalid_argument for a session that is not given by 8 to 32 lower-case hexadecimal digits.
  explicit LeftOut(LeaveOut what);

  // Moves the sessions that are left out from the snapshot to this object.
  void take(Snapshot& snapshot);
  // Whether the record is left out. Then a copy of it is kept.
  bool take(const Record& record);

  bool wanted() const { return !what_.sessions.empty() || !what_.records.empty(); }
  // Throws std::invalid_argument if something that was to be left out has not been found, or is not unique.
  void check_found() const;
  // Writes what has been taken to new files. Returns a line for the log.
  std::string set_aside(Storage& storage, const StoreId& store) const;

 private:
  struct Kept {
    SessionKey session;
    std::uint64_t sequence;
    std::uint64_t previous_reply;
    std::vector<std::byte> header_frame, payload_frame;
    std::string identity;
  };
  bool names(const SessionKey& session);

  LeaveOut what_;
  std::map<std::string, std::set<SessionKey>> found_;  // sessions that match each of what_.sessions
  std::set<std::uint64_t> found_records_;
  std::set<SessionKey> cut_;  // sessions of records that are left out
  Snapshot sessions_;
  std::vector<Kept> records_;
};

}  // namespace shearbus::store
