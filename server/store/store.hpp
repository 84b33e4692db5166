// The state directory: checkpoints and the journal between them. The store decides what is recovered at the start, what
// is kept of each request and when a checkpoint is due. It does not interpret requests.
//
// Recovery loads the newest sound checkpoint and replays every later record. A damaged file is never loaded and never
// skipped without a message. A checkpoint that is damaged or cannot be read is replaced by the checkpoint before it and
// the journal since then. A damaged journal has no replacement: the server stops and an operator must decide. A file of
// another directory is never used. No file that this store has not written or read is removed or overwritten.
#pragma once

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/physics/numerics.hpp"
#include "server/store/journal.hpp"
#include "server/store/left_out.hpp"
#include "server/store/snapshot.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

enum class Durability {
  kNone,     // checkpoints only: requests after the last checkpoint are lost with the server
  kProcess,  // a request is journaled before its answer: it survives the death of the server process
  kPower,    // a request is on the disk before its answer: it survives a loss of power
};
const char* name(Durability durability);

using physics::kNumericsVersion;

struct StoreOptions {
  Durability durability = Durability::kProcess;
  std::uint64_t epoch = 1;  // random number that identifies this start of the server
  // a checkpoint is due when the journal has grown by this size since the last one  [bytes]
  std::uint64_t checkpoint_bytes = std::uint64_t{256} << 20;
  double checkpoint_work = 3e9;  // a checkpoint is due after this work of journaled requests  [evaluations]
  std::uint16_t numerics = kNumericsVersion;  // version of the numerics that answers requests
  std::size_t max_capsules = 16;  // largest number of failure capsules in the directory; later ones are not written
  StoreId fresh_id{};             // random id that a new directory gets
  LeaveOut leave_out;             // sessions and records that the recovery leaves out and sets aside
  bool accept_empty = false;      // rename unusable files and start without states, instead of refusing to start
  std::function<void(const std::string&)> log;  // lines for the operator; may be empty
};

// Thrown by a Recovery that shall not go on. It is no std::exception, so nobody takes it for damage: no file is
// changed, and the next start begins again.
struct Interrupted {};

// Receives the recovered states and requests.
class Recovery {
 public:
  virtual ~Recovery() = default;
  virtual void restore(const Snapshot& snapshot) = 0;                  // called first, if there is a checkpoint
  virtual void replay(const Record& record, std::uint64_t epoch) = 0;  // for each record after the checkpoint, in order
  virtual void clear() = 0;                                            // called to discard everything recovered so far
};

struct StoreCounters {
  std::uint64_t records = 0;  // records written since the start
  std::uint64_t record_bytes = 0;
  std::uint64_t replayed = 0;     // records replayed at the start
  std::uint64_t checkpoints = 0;  // checkpoints written since the start
  std::uint64_t checkpoints_failed = 0;
  std::uint64_t checkpoint_bytes = 0;  // size of the last checkpoint  [bytes]
};

class Store {
 public:
  Store(Storage& storage, StoreOptions options);

  // Must be called once, before any other member. Throws DamagedFile or StorageError if files cannot be used and
  // accept_empty is not set. An exception thrown by `recovery` counts as damage.
  void recover(Recovery& recovery);
  double share_replayed() const { return share_replayed_; }  // of the records that recover() replays, 0 to 1
  std::string replaying() const;                             // which record that is, for the log; empty: none yet

  // Whether the recovery has left something out. The caller must write a checkpoint before it answers requests, or the
  // next recovery would find it again.
  bool left_something_out() const { return left_out_.wanted(); }

  // Records a request before it is executed. Throws StorageError: if no_space() is true nothing was recorded and a
  // later call may succeed; any other failure is final.
  void append(const Record& record);
  // Makes the appended records as durable as StoreOptions::durability promises. A failure is final.
  void settle();
  bool failed() const { return failed_; }  // true after a failure that no retry can repair: no request may be answered

  // Adds the work of a request that has been run or replayed  [evaluations].
  void add_work(double work) { work_since_checkpoint_ += work; }
  double checkpoint_work() const { return options_.checkpoint_work; }
  bool checkpoint_due() const;
  bool changed_since_checkpoint() const { return changed_; }
  // A checkpoint in three parts: writes a snapshot of the present state, reads it back for verification and removes files
  // that are no longer needed. write() touches only the files of the checkpoint, so another thread may make it while
  // requests are recorded; it never throws. One job at a time. end_checkpoint() returns false if the snapshot could not be
  // written; the older checkpoints and the journal then still hold everything.
  struct CheckpointJob;
  std::shared_ptr<CheckpointJob> begin_checkpoint(Snapshot snapshot);
  void write(CheckpointJob& job) const;
  bool end_checkpoint(CheckpointJob& job);

  // Writes a failure capsule and returns its file name, which is empty if the directory holds max_capsules already.
  // Throws StorageError; the answers do not depend on capsules.
  std::string leave_capsule(const Capsule& capsule);

  Durability durability() const { return options_.durability; }
  bool journaling() const { return options_.durability != Durability::kNone; }
  std::uint64_t next_index() const { return next_index_; }
  const StoreCounters& counters() const { return counters_; }

 private:
  struct Found;
  struct Missed {  // a journal segment that cannot be used; `cause` is null if it is empty or of another directory
    // Of several segments one with a cause counts, and then the first.
    void note(const std::string& fault, const std::exception_ptr& why = {}) {
      if (text.empty() || (why && !cause)) *this = {.text = fault, .cause = why};
    }
    std::string text;
    std::exception_ptr cause;
  };
  struct Restored {
    std::uint64_t next_index = 0;  // index of the first record that the restored checkpoint does not include
    std::string faults;            // faults of the checkpoints that were not loaded
    std::exception_ptr unread;     // the first StorageError among `faults`
  };

  Found find();
  void recover_from(const Found& found, Recovery& recovery);
  bool read_identity(const Found& found);
  void adopt_id(const Found& found);
  bool is_foreign(const StoreId& id, const std::string& file) const;
  Restored restore_newest(const Found& found, Recovery& recovery);
  void refuse_other_states(const Found& found, const std::string& fault);
  std::optional<Segment> segment_in(const std::string& file, std::uint64_t number, std::vector<std::byte>& bytes,
                                    Missed& missed);
  void check_order(const Segment& segment, const std::string& file, std::uint64_t end, const Missed& missed,
                   const Restored& restored) const;
  bool replay_segments(const Found& found, const Restored& restored, Recovery& recovery);
  std::string unused_suffix(const Found& found, const std::vector<std::string>& files) const;
  void start_empty(const Found& found, Recovery& recovery, const std::string& fault);
  void write_new(const std::string& file, Bytes bytes, bool synced) const;
  void write_identity(StoreIdentity identity);
  void publish_identity(const StoreIdentity& identity);
  void start_segment();
  void end_segment();
  void prune();
  void log(const std::string& line) const;

  Storage& storage_;
  StoreOptions options_;
  StoreIdentity identity_;
  std::unique_ptr<JournalWriter> journal_;  // null until the next record begins a new segment of the journal
  std::uint64_t next_index_ = 0;
  std::uint64_t next_segment_ = 1;
  std::uint64_t next_generation_ = 1;
  std::uint64_t bytes_since_checkpoint_ = 0;
  std::uint64_t retry_at_bytes_ = 0;    // bytes_since_checkpoint_ at which a failed checkpoint is tried again
  double work_since_checkpoint_ = 0.0;  // [evaluations]
  double retry_at_work_ = 0.0;          // work_since_checkpoint_ at which a failed checkpoint is tried again
  double share_replayed_ = 0.0;
  const Record* replaying_ = nullptr;
  LeftOut left_out_;
  bool changed_ = false;
  bool failed_ = false;
  struct Kept {
    std::uint64_t number;  // number of the file
    std::uint64_t index;   // index of a record: the first one after the checkpoint, or the first one in the segment
  };
  std::vector<Kept> checkpoints_;        // sound checkpoints, oldest first
  std::vector<Kept> segments_;           // journal segments that were replayed or written, oldest first
  std::vector<std::uint64_t> attempts_;  // numbers of the checkpoints that were begun but not verified as sound
  StoreCounters counters_;
};

}  // namespace shearbus::store
