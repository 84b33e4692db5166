#include "server/store/store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <exception>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "proto/files/record_file.hpp"
#include "proto/wire/text.hpp"
#include "server/store/checkpoint.hpp"

namespace shearbus::store {
namespace {

constexpr std::string_view kUnfinished = ".tmp";
constexpr std::string_view kSetAside = ".unused";
constexpr std::size_t kGenerationsKept = 2;

constexpr const char* kOfRestoring =
    ". Restore the file from a backup; or lose the states: shearbus-server --accept-empty sets every file aside, a "
    "host "
    "with the server in its own process names another state directory";
constexpr const char* kOfLoss =
    ". Restore the file from a backup, or start shearbus-server once with --durability process, which goes on from "
    "what is there";

// Returns the number in a file name of this kind, or nothing for any other name.
std::optional<std::uint64_t> number_in(const std::string& file, std::string_view prefix,
                                       std::string (*name_of)(std::uint64_t)) {
  constexpr std::size_t kDigits = 12;
  std::uint64_t number = 0;
  if (!file.starts_with(prefix) || file.size() < prefix.size() + kDigits) return {};
  const char* const digits = file.data() + prefix.size();
  if (std::from_chars(digits, digits + kDigits, number).ec != std::errc() || file != name_of(number)) return {};
  return number;
}

StoreIdentity identity_in(Bytes bytes) {
  const std::string file = kIdentityName;
  StoreIdentity identity;
  if (bytes.size() != sizeof identity)
    throw DamagedFile(fmt::format("{}: {} bytes, expected {}", file, bytes.size(), sizeof identity));
  std::memcpy(&identity, bytes.data(), sizeof identity);
  if (identity.magic != kIdentityMagic || identity.sum != files::sum_of_header(identity))
    throw DamagedFile(file + ": its bytes do not match their sum");
  return identity;
}

}  // namespace

const char* name(Durability durability) {
  return std::array{"none", "process", "power"}.at(static_cast<std::size_t>(durability));
}

// The files of the directory by kind, each kind by its numbers.
struct Store::Found {
  std::set<std::uint64_t> checkpoints, segments, capsules;
  std::vector<std::string> unfinished;
  std::set<std::string> names;  // names of all files
};

Store::Store(Storage& storage, StoreOptions options)
    : storage_(storage), options_(std::move(options)), left_out_(options_.leave_out) {}

std::string Store::replaying() const {
  if (replaying_ == nullptr) return {};
  return fmt::format("record {}, request {} of session {:.8}", replaying_->index, replaying_->sequence,
                     hexadecimal(replaying_->session));
}

void Store::log(const std::string& line) const {
  if (options_.log) options_.log(line);
}

Store::Found Store::find() {
  Found found;
  for (std::string& file : storage_.list()) {
    std::string_view finished = file;
    if (finished.ends_with(kUnfinished)) finished.remove_suffix(kUnfinished.size());
    const std::string kept(finished);
    const auto checkpoint = number_in(kept, "checkpoint-", checkpoint_name);
    const auto segment = number_in(kept, "journal-", segment_name);
    const auto capsule = number_in(kept, "capsule-", capsule_name);
    if (kept != file) {
      if (checkpoint || capsule || kept == kIdentityName) found.unfinished.push_back(file);
    } else if (checkpoint) {
      found.checkpoints.insert(*checkpoint);
    } else if (segment) {
      found.segments.insert(*segment);
    } else if (capsule) {
      found.capsules.insert(*capsule);
    }
    found.names.insert(std::move(file));
  }
  return found;
}

void Store::recover(Recovery& recovery) {
  const Found found = find();
  for (const std::string& file : found.names)
    if ((file.starts_with("checkpoint-") || file.starts_with("journal-")) &&
        (file.ends_with(".h5") || file.ends_with(".log")) && !number_in(file, "checkpoint-", checkpoint_name) &&
        !number_in(file, "journal-", segment_name))
      log(file + " is no file of this server: it is left alone");
  for (const std::string& file : found.unfinished) discard(storage_, file);
  try {
    recover_from(found, recovery);
  } catch (const std::exception& fault) {
    const std::string text = fault.what();
    if (dynamic_cast<const OtherNumerics*>(&fault) != nullptr) throw;
    if (options_.accept_empty && !left_out_.wanted()) return start_empty(found, recovery, text);
    if (dynamic_cast<const DamagedFile*>(&fault) == nullptr || dynamic_cast<const OtherOptions*>(&fault) != nullptr ||
        text.ends_with(kOfLoss))
      throw;
    throw DamagedFile(text + kOfRestoring);
  }
}

void Store::recover_from(const Found& found, Recovery& recovery) {
  const bool identified = read_identity(found);
  const Restored restored = restore_newest(found, recovery);
  const bool lost = replay_segments(found, restored, recovery);
  if (left_out_.wanted()) {
    left_out_.check_found();
    log(left_out_.set_aside(storage_, identity_.id));
    changed_ = true;
  }
  next_segment_ = std::max(identity_.last_segment, segments_.empty() ? 0 : segments_.back().number) + 1;
  next_generation_ = std::max(identity_.last_checkpoint, checkpoints_.empty() ? 0 : checkpoints_.back().number) + 1;
  if (!identified) {
    if (found.names.contains(kIdentityName))
      storage_.rename(kIdentityName, kIdentityName + unused_suffix(found, {kIdentityName}));
    write_identity(identity_);
    publish_identity(identity_);
  }
  if (lost && journaling()) start_segment();  // a later start then does not report the loss again
}

// Reads the directory's id. Returns false if no file gives it: the directory is new, or the file is lost or damaged.
// The id is then that of the newest sound checkpoint or segment, or options_.fresh_id if there is none.
bool Store::read_identity(const Found& found) {
  const bool there = found.names.contains(kIdentityName);
  std::string fault = "it is missing";
  if (there) {
    try {
      identity_ = identity_in(storage_.read(kIdentityName));
      if (identity_.version == kIdentityVersion) return true;
    } catch (const DamagedFile& why) {
      fault = why.what();
    }
    if (identity_.version != kIdentityVersion)
      throw DamagedFile(fmt::format("{}: version {}; this server reads version {}", kIdentityName, identity_.version,
                                    kIdentityVersion));
  }
  identity_ = {.id = options_.fresh_id};
  if (!found.checkpoints.empty() || !found.segments.empty()) {
    const std::string text = fmt::format(
        "{}, the file that names the newest checkpoint and segment: {}; expected beside {} checkpoints and {} segments",
        kIdentityName, fault, found.checkpoints.size(), found.segments.size());
    if (options_.durability == Durability::kPower) throw DamagedFile(text + kOfLoss);
    log("LOST: " + text + ". Whether later files are lost cannot be known");
    if (!found.segments.empty()) identity_.last_segment = *found.segments.rbegin();
    adopt_id(found);
  }
  return false;
}

void Store::adopt_id(const Found& found) {
  for (auto generation = found.checkpoints.rbegin(); generation != found.checkpoints.rend(); ++generation) {
    const std::string file = checkpoint_name(*generation);
    try {
      identity_.id = read_checkpoint(storage_.read(file), file, *generation).store;
      return;
    } catch (const std::exception&) {
      // restore_newest() reports the fault.
    }
  }
  for (auto number = found.segments.rbegin(); number != found.segments.rend(); ++number) {
    const std::string file = segment_name(*number);
    try {
      const std::vector<std::byte> bytes = storage_.read(file);
      const Segment segment = read_segment(bytes, file);
      if (segment.sound_bytes == 0) continue;
      identity_.id = segment.store;
      return;
    } catch (const std::exception&) {
      // replay_segments() reports the fault.
    }
  }
}

bool Store::is_foreign(const StoreId& id, const std::string& file) const {
  if (id == identity_.id) return false;
  log(fmt::format("FOREIGN: {} belongs to the state directory {}, this is {}; it is not used and left as it is", file,
                  hexadecimal(id), hexadecimal(identity_.id)));
  return true;
}

Store::Restored Store::restore_newest(const Found& found, Recovery& recovery) {
  Restored restored;
  std::optional<Snapshot> newest;
  for (auto generation = found.checkpoints.rbegin(); generation != found.checkpoints.rend(); ++generation) {
    const std::string file = checkpoint_name(*generation);
    try {
      Snapshot snapshot = read_checkpoint(storage_.read(file), file, *generation);
      if (is_foreign(snapshot.store, file)) continue;
      checkpoints_.insert(checkpoints_.begin(), {*generation, snapshot.next_index});
      if (!newest) newest = std::move(snapshot);
    } catch (const std::exception& fault) {  // damaged, unreadable or too large for the memory
      if (dynamic_cast<const StorageError*>(&fault) != nullptr && !restored.unread)
        restored.unread = std::current_exception();
      log(std::string("DAMAGED: checkpoint not loaded: ") + fault.what());
      restored.faults += (restored.faults.empty() ? "" : "; ") + std::string(fault.what());
    }
  }
  const std::string last = checkpoint_name(identity_.last_checkpoint);
  if (identity_.last_checkpoint != 0 && !found.names.contains(last)) {
    log("LOST: " + last + ", the newest checkpoint, is missing");
    restored.faults += (restored.faults.empty() ? "" : "; ") + last + " is missing";
  }
  if (!newest) return restored;
  left_out_.take(*newest);
  try {
    recovery.restore(*newest);
  } catch (const std::invalid_argument& fault) {
    refuse_other_states(found, checkpoint_name(checkpoints_.back().number) + ": " + fault.what());
    throw;
  }
  log(fmt::format("restored {}: {}", checkpoint_name(checkpoints_.back().number),
                  wire::counted(newest->sessions.size(), "session")));
  restored.next_index = newest->next_index;
  return restored;
}

// Throws OtherNumerics if another version of the numerics wrote the newest segment, and therefore the states of the
// checkpoint that `fault` says do not fit.
void Store::refuse_other_states(const Found& found, const std::string& fault) {
  if (found.segments.empty()) return;
  std::vector<std::byte> bytes;
  Missed missed;
  const std::uint64_t number = *found.segments.rbegin();
  const auto segment = segment_in(segment_name(number), number, bytes, missed);
  if (!segment || segment->numerics == options_.numerics) return;
  throw OtherNumerics(fmt::format(
      "{0}. These states are of numerics {1}, and this server has numerics {2}, which has other ones for the "
      "same scene. Start the server whose --version says numerics {1} and finish its sessions there, or "
      "leave them out (--drop-session)",
      fault, segment->numerics, options_.numerics));
}

// Reads a segment of this directory. Returns nothing for a file that cannot hold a record of this directory. Returns
// nothing, and the fault in `missed`, for a file that may have held records.
std::optional<Segment> Store::segment_in(const std::string& file, std::uint64_t number, std::vector<std::byte>& bytes,
                                         Missed& missed) {
  // A segment is named as the newest one in the file `store` before its first record is written, so no segment with a
  // later number holds a record.
  const bool noted = number <= identity_.last_segment;
  try {
    bytes = storage_.read(file);
    Segment segment = read_segment(bytes, file);
    if (segment.sound_bytes == 0) {
      if (noted)
        missed.note(file + " is empty or zeroed");
      else
        log(file + " holds no record and is left alone");
      return {};
    }
    if (is_foreign(segment.store, file)) {
      if (noted) missed.note(file + " is a file of another directory");
      return {};
    }
    if (segment.number != number)
      throw DamagedFile(fmt::format("{}: it is segment {} under the name of another", file, segment.number));
    return segment;
  } catch (const std::exception& why) {
    if (noted)
      missed.note(why.what(), std::current_exception());
    else
      log(std::string(why.what()) + "; it is no file of this server and left alone");
    return {};
  }
}

// Throws if records are missing between the records read so far and the segment, or if the segment begins with records
// that were read already. `end` is the index after the last record read.
void Store::check_order(const Segment& segment, const std::string& file, std::uint64_t end, const Missed& missed,
                        const Restored& restored) const {
  const std::string begins = fmt::format("{}: it begins with record {}", file, segment.first_index);
  if (segment.first_index > next_index_) {
    for (const std::exception_ptr& cause : {missed.cause, restored.unread})
      if (cause) std::rethrow_exception(cause);
    throw DamagedFile(
        fmt::format("{}{}{}; records from {} on are missing",
                    restored.faults.empty() ? "" : "no checkpoint can be loaded: " + restored.faults + "; ",
                    missed.text.empty() ? "" : missed.text + "; ", begins, next_index_));
  }
  if (segment.first_index < end)
    throw DamagedFile(fmt::format(
        "{}; expected record {}, since the segments before hold the ones up to there: these are two histories", begins,
        end));
}

// Replays the records that the restored checkpoint does not include. Settled records are those that the journal says it
// has written whole. If some of them are missing at its end, throws under Durability::kPower, otherwise returns true.
bool Store::replay_segments(const Found& found, const Restored& restored, Recovery& recovery) {
  next_index_ = restored.next_index;
  Missed missed;          // fault of a segment after the last usable one
  std::string lost;       // message about settled records that are missing at the end of the journal; empty: none
  std::uint64_t end = 0;  // index after the last record of the segments read so far
  double segments_read = 0.0;
  const auto num_segments = static_cast<double>(found.segments.size());
  for (const std::uint64_t number : found.segments) {
    share_replayed_ = segments_read++ / num_segments;
    const std::string file = segment_name(number);
    std::vector<std::byte> bytes;
    const auto segment = segment_in(file, number, bytes, missed);
    if (!segment) continue;
    check_order(*segment, file, end, missed, restored);
    if (!missed.text.empty()) log("DAMAGED: " + missed.text + "; the other files hold its records");
    missed = {};
    lost.clear();
    for (const Record& record : segment->records) {
      if (record.index < next_index_) continue;
      if (segment->numerics != options_.numerics)
        throw OtherNumerics(fmt::format(
            "{0}: record {1} and those after it were answered by numerics {2}, and this server has numerics {3}. Start "
            "the server whose --version says numerics {2} and stop it cleanly (SIGTERM): it leaves a checkpoint and "
            "nothing to replay. Then start this one",
            file, record.index, segment->numerics, options_.numerics));
      const auto place = static_cast<double>(record.index - segment->first_index);
      share_replayed_ = (segments_read - 1.0 + place / static_cast<double>(segment->records.size())) / num_segments;
      replaying_ = &record;
      if (!left_out_.take(record)) recovery.replay(record, segment->epoch);
      replaying_ = nullptr;
      ++next_index_;
      if (!record.header_frame.empty()) ++counters_.replayed;
    }
    end = segment->next_index();
    if (segment->settled > std::max(end, restored.next_index))
      lost = fmt::format("{}: it held records {} to {}, found {}", file, segment->first_index, segment->settled - 1,
                         segment->records.empty() ? "none" : fmt::format("them up to {}", end - 1));
    else if (segment->torn)
      log(file + ": it ends in the middle of a record, whose request was never answered");
    bytes_since_checkpoint_ += segment->sound_bytes;
    segments_.push_back({number, segment->first_index});
    // A server that died may have left records that only the cache of the machine holds. Later records follow them.
    if (options_.durability == Durability::kPower) storage_.sync(file);
  }
  changed_ = counters_.replayed != 0;
  if (changed_) log(fmt::format("replayed {} from the journal", wire::counted(counters_.replayed, "request")));
  if (missed.cause) std::rethrow_exception(missed.cause);
  if (segments_.empty() && checkpoints_.empty() && restored.unread) std::rethrow_exception(restored.unread);
  if (segments_.empty() && checkpoints_.empty() && !restored.faults.empty())
    throw DamagedFile("no checkpoint can be loaded: " + restored.faults);
  if (identity_.last_segment > (segments_.empty() ? 0 : segments_.back().number))
    lost = fmt::format("{}, the newest segment, held the records from {} on; found: {}",
                       segment_name(identity_.last_segment), identity_.first_index,
                       missed.text.empty() ? "no such file" : missed.text);
  if (lost.empty()) return false;
  if (options_.durability == Durability::kPower) throw DamagedFile(lost + kOfLoss);
  log(fmt::format("LOST: {}. The sessions go on from record {}", lost, next_index_));
  return true;
}

// Returns the first suffix under which none of the files has been set aside before.
std::string Store::unused_suffix(const Found& found, const std::vector<std::string>& files) const {
  std::string suffix(kSetAside);
  for (int again = 2; std::ranges::any_of(files, [&](const auto& file) { return found.names.contains(file + suffix); });
       ++again)
    suffix = fmt::format("{}-{}", kSetAside, again);
  return suffix;
}

void Store::start_empty(const Found& found, Recovery& recovery, const std::string& fault) {
  recovery.clear();
  log("LOST: the states on disk cannot be used: " + fault);
  std::vector<std::string> files;
  for (const std::uint64_t generation : found.checkpoints) files.push_back(checkpoint_name(generation));
  for (const std::uint64_t number : found.segments) files.push_back(segment_name(number));
  const Found now = find();
  if (now.names.contains(kIdentityName)) files.emplace_back(kIdentityName);
  const std::string suffix = unused_suffix(now, files);
  for (const std::string& file : files) storage_.rename(file, file + suffix);
  storage_.sync_directory();
  log("every file was renamed to *" + suffix + "; starting with no states");
  checkpoints_.clear();
  segments_.clear();
  next_index_ = 0;
  bytes_since_checkpoint_ = 0;
  counters_.replayed = 0;
  changed_ = false;
  identity_ = {.id = options_.fresh_id};
  write_identity(identity_);
  publish_identity(identity_);
}

// Writes a new file, or removes what could be written of it and throws. A file that exists already stays.
void Store::write_new(const std::string& file, Bytes bytes, bool synced) const {
  std::unique_ptr<File> opened;
  try {
    opened = storage_.create(file);
    const std::array<Bytes, 1> parts = {bytes};
    opened->append(parts);
    if (synced) opened->sync();
  } catch (const std::exception& fault) {
    // If memory runs out, create() may throw after it has made the file.
    const bool refused = opened == nullptr && dynamic_cast<const StorageError*>(&fault) != nullptr;
    if (!refused) discard(storage_, file);
    throw;
  }
}

void Store::write_identity(StoreIdentity identity) {
  identity.sum = files::sum_of_header(identity);
  write_new(kIdentityName + std::string(kUnfinished), std::as_bytes(std::span(&identity, 1)), true);
}

void Store::publish_identity(const StoreIdentity& identity) {
  const std::string unfinished = kIdentityName + std::string(kUnfinished);
  try {
    storage_.rename(unfinished, kIdentityName);
  } catch (const std::exception&) {
    discard(storage_, unfinished);
    throw;
  }
  storage_.sync_directory();
  identity_ = identity;
}

// Begins a journal segment for the next record, and names it as the newest segment in the file `store`. Skips numbers
// for which a file exists, whoever made it.
void Store::start_segment() {
  const Found found = find();
  while (found.names.contains(segment_name(next_segment_))) ++next_segment_;
  const std::uint64_t number = next_segment_++;
  auto journal = std::make_unique<JournalWriter>(storage_, segment_name(number),
                                                 SegmentHeader{.numerics = options_.numerics,
                                                               .number = number,
                                                               .epoch = options_.epoch,
                                                               .first_index = next_index_,
                                                               .store = identity_.id},
                                                 options_.durability == Durability::kPower);
  StoreIdentity identity = identity_;
  identity.last_segment = number;
  identity.first_index = next_index_;
  try {
    write_identity(identity);
  } catch (const std::exception&) {
    discard(storage_, segment_name(number));
    throw;
  }
  failed_ = true;
  publish_identity(identity);
  failed_ = false;
  journal_ = std::move(journal);
  segments_.push_back({number, next_index_});
}

void Store::append(const Record& record) {
  if (failed_) throw StorageError("the journal has failed before", EIO);
  changed_ = true;
  if (!journaling()) {
    bytes_since_checkpoint_ += record.header_frame.size() + record.payload_frame.size();
    ++next_index_;  // a later journal must not begin with the index of this record
    return;
  }
  std::uint64_t before = 0;
  const auto write = [&] {
    if (!journal_) start_segment();
    before = journal_->bytes();
    journal_->append(record);
  };
  try {
    try {
      write();
    } catch (const StorageError& fault) {
      // A segment of the largest size that a file may have is continued in another file.
      if (fault.code() != EFBIG || !journal_ || journal_->broken() || journal_->next_index() == journal_->first_index())
        throw;
      end_segment();
      write();
    }
  } catch (const StorageError& fault) {
    failed_ = failed_ || (journal_ ? journal_->broken() : !fault.no_space());
    throw;
  }
  const std::uint64_t written = journal_->bytes() - before;
  next_index_ = journal_->next_index();
  bytes_since_checkpoint_ += written;
  counters_.record_bytes += written;
  ++counters_.records;
}

void Store::settle() {
  if (failed_) throw StorageError("the journal has failed before", EIO);
  if (!journal_) return;
  failed_ = true;
  journal_->settle();
  failed_ = false;
}

// Later records begin a new segment. Its sync does not reach the records of this one, so these are made durable here.
void Store::end_segment() {
  settle();
  journal_.reset();
}

bool Store::checkpoint_due() const {
  return changed_ && !failed_ &&
         (bytes_since_checkpoint_ >= std::max(options_.checkpoint_bytes, retry_at_bytes_) ||
          work_since_checkpoint_ >= std::max(options_.checkpoint_work, retry_at_work_));
}

struct Store::CheckpointJob {
  Snapshot snapshot;             // until it is written
  std::uint64_t next_index = 0;  // of the snapshot
  std::uint64_t generation = 0;
  std::uint64_t bytes_before = 0;  // journal size and work since the checkpoint before
  double work_before = 0.0;
  std::uint64_t size = 0;  // of the file
  bool named = false;      // the file may have its name
  std::string fault;       // empty: the checkpoint is sound
};

// Ends the segment, so that it can be removed once its records are not needed. The records are made durable before the
// checkpoint that includes them: if that checkpoint is damaged later, they are replayed after the checkpoint before it.
std::shared_ptr<Store::CheckpointJob> Store::begin_checkpoint(Snapshot snapshot) {
  auto job = std::make_shared<CheckpointJob>();
  job->snapshot = std::move(snapshot);
  job->snapshot.next_index = job->next_index = next_index_;
  job->snapshot.store = identity_.id;
  job->bytes_before = std::exchange(bytes_since_checkpoint_, 0);
  job->work_before = std::exchange(work_since_checkpoint_, 0.0);
  changed_ = false;
  try {
    if (journal_ && journal_->next_index() != journal_->first_index()) end_segment();
    const Found found = find();
    while (found.names.contains(checkpoint_name(next_generation_))) ++next_generation_;
  } catch (const std::exception& fault) {
    job->fault = fault.what();
  }
  // After a failure a file with this generation may exist with unknown contents, so the number is not reused.
  job->generation = next_generation_++;
  return job;
}

namespace {

// The bytes of a snapshot, whose memory is given up before they are written.
std::vector<std::byte> image_of(Snapshot snapshot, std::uint64_t generation) {
  if (const auto complete = std::exchange(snapshot.complete, nullptr)) complete(snapshot);
  return checkpoint_bytes(snapshot, generation);
}

}  // namespace

void Store::write(CheckpointJob& job) const try {
  if (!job.fault.empty()) return;
  const std::string file = checkpoint_name(job.generation);
  const std::string unfinished = file + std::string(kUnfinished);
  write_new(unfinished, image_of(std::move(job.snapshot), job.generation), true);
  job.named = true;
  storage_.rename(unfinished, file);
  storage_.sync_directory();
  job.size = verified_image(storage_.read(file), file, job.generation).size() + sizeof(CheckpointFooter);
} catch (const std::exception& fault) {
  job.fault = *fault.what() != '\0' ? fault.what() : "unknown fault";
}

bool Store::end_checkpoint(CheckpointJob& job) {
  if (!job.fault.empty()) {
    if (job.named) attempts_.push_back(job.generation);
    bytes_since_checkpoint_ += job.bytes_before;
    work_since_checkpoint_ += job.work_before;
    changed_ = true;
    ++counters_.checkpoints_failed;
    retry_at_bytes_ = bytes_since_checkpoint_ + options_.checkpoint_bytes / 8 + 1;
    retry_at_work_ = work_since_checkpoint_ + options_.checkpoint_work / 8;
    log("ALARM: the checkpoint could not be written: " + job.fault +
        "; the ones before and the journal hold everything");
    return false;
  }
  retry_at_bytes_ = 0;
  retry_at_work_ = 0.0;
  ++counters_.checkpoints;
  counters_.checkpoint_bytes = job.size;
  checkpoints_.push_back({job.generation, job.next_index});
  try {
    StoreIdentity identity = identity_;
    identity.last_checkpoint = checkpoints_.back().number;
    write_identity(identity);
    publish_identity(identity);
    prune();
  } catch (const std::exception& fault) {
    log(std::string("ALARM: old files could not be put away: ") + fault.what());
  }
  return true;
}

std::string Store::leave_capsule(const Capsule& capsule) {
  const auto there = find().capsules;
  if (there.size() >= options_.max_capsules) return {};
  std::string file = capsule_name(there.empty() ? 1 : *there.rbegin() + 1);
  write_new(file + std::string(kUnfinished), capsule_bytes(capsule), false);
  storage_.rename(file + std::string(kUnfinished), file);
  return file;
}

// Keeps the newest kGenerationsKept sound checkpoints and every segment with a record that the oldest of them does not
// include. Removes only files that this store has read or written: the older checkpoints and those that a failed
// attempt left. Damaged and foreign files stay. The removal of checkpoints is durable before the first segment is
// removed, because a checkpoint without the later segments cannot be used.
void Store::prune() {
  for (const std::uint64_t generation : attempts_)
    for (const std::string_view suffix : {std::string_view(), kUnfinished})
      discard(storage_, checkpoint_name(generation).append(suffix));
  attempts_.clear();
  if (checkpoints_.size() < kGenerationsKept) return;
  for (; checkpoints_.size() > kGenerationsKept; checkpoints_.erase(checkpoints_.begin()))
    storage_.remove(checkpoint_name(checkpoints_.front().number));
  storage_.sync_directory();
  while (segments_.size() > 1 && segments_[1].index <= checkpoints_.front().index) {
    storage_.remove(segment_name(segments_.front().number));
    segments_.erase(segments_.begin());
  }
}

}  // namespace shearbus::store
