// The state directory: checkpoints and the journal between them. It says what is recovered at start, what is kept of
// every request, and when the states themselves are written; it knows nothing of what requests mean.
//
// Recovery takes the newest sound checkpoint and replays every later record on it. What is damaged is never loaded and
// never passed over in silence: a checkpoint has the one before it, and the journal since, to fall back on; a journal
// has not, so a damaged one stops the server and asks for a person.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/store/journal.hpp"
#include "server/store/snapshot.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

enum class Durability {
  kNone,     // checkpoints only: what came after the last one is lost with the server
  kProcess,  // journaled before it is answered: survives the death of the server, not of the machine
  kPower,    // and brought to the disk before it is answered: survives the loss of power
};
const char* name(Durability durability);

struct StoreOptions {
  Durability durability = Durability::kProcess;
  std::uint64_t epoch = 1;                                    // of this incarnation of the server
  std::uint64_t checkpoint_bytes = std::uint64_t{256} << 20;  // of journal, after which a checkpoint is due
  std::size_t max_capsules = 16;  // failure capsules in the directory; more are not written until some are taken away
  bool accept_empty = false;      // set unreadable files aside and start with nothing, instead of refusing to
  std::function<void(const std::string&)> log;  // what a person should know; may be empty
};

// How recovery gives back what it found.
class Recovery {
 public:
  virtual ~Recovery() = default;
  virtual void restore(const Snapshot& snapshot) = 0;                  // first, where there is a checkpoint
  virtual void replay(const Record& record, std::uint64_t epoch) = 0;  // then every later record, in order
  virtual void clear() = 0;                                            // what was recovered so far is not to be used
};

struct StoreCounters {
  std::uint64_t records = 0;  // written since the start
  std::uint64_t record_bytes = 0;
  std::uint64_t replayed = 0;     // at the start
  std::uint64_t checkpoints = 0;  // written since the start
  std::uint64_t checkpoints_failed = 0;
  std::uint64_t checkpoint_bytes = 0;  // of the last one
};

class Store {
 public:
  Store(Storage& storage, StoreOptions options);

  // Once, before anything else. Throws DamagedFile or StorageError where there are files that cannot be used and
  // accept_empty is not set; whatever `recovery` throws counts as damage.
  void recover(Recovery& recovery);

  // Keeps a request that is about to be run. Throws StorageError: where it says no_space() nothing was kept and the
  // next call may succeed; any other failure is final.
  void append(const Record& record);
  // What was appended is as durable as the mode promises. A failure is final.
  void settle();
  bool failed() const { return failed_; }  // finally: nothing may be answered any more

  bool checkpoint_due() const;
  bool changed_since_checkpoint() const { return changed_; }
  // Writes the snapshot, which holds everything up to now, reads it back, and removes what is not needed any more.
  // False where it could not be written: the ones before and the journal still hold everything.
  bool checkpoint(Snapshot snapshot);

  // Failure capsules: how many more there is room for, and one of them, which returns the file's name. Both throw
  // StorageError; nothing depends on them.
  std::size_t capsule_room();
  std::string leave_capsule(const Capsule& capsule);

  Durability durability() const { return options_.durability; }
  bool journaling() const { return options_.durability != Durability::kNone; }
  std::uint64_t next_index() const { return next_index_; }
  const StoreCounters& counters() const { return counters_; }

 private:
  struct Found;

  Found find();
  void recover_from(const Found& found, Recovery& recovery);
  std::uint64_t restore_newest(const Found& found, Recovery& recovery);
  void replay_segments(const Found& found, std::uint64_t base, Recovery& recovery);
  void set_aside(const Found& found);
  void start_segment();
  void write_checkpoint(const Snapshot& snapshot);
  void prune();
  void log(const std::string& line) const;

  Storage& storage_;
  StoreOptions options_;
  std::unique_ptr<JournalWriter> journal_;
  std::uint64_t next_index_ = 0;
  std::uint64_t next_segment_ = 1;
  std::uint64_t next_generation_ = 1;
  std::uint64_t bytes_since_checkpoint_ = 0;
  std::uint64_t retry_at_bytes_ = 0;  // of journal: a checkpoint that failed is not tried again at every request
  bool changed_ = false;
  bool failed_ = false;
  struct Kept {
    std::uint64_t number;  // of the file
    std::uint64_t index;   // checkpoint: next_index; segment: first_index
  };
  std::vector<Kept> checkpoints_;  // sound ones, oldest first
  std::vector<Kept> segments_;     // oldest first
  StoreCounters counters_;
};

}  // namespace shearbus::store
