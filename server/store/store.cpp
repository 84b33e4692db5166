#include "server/store/store.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <exception>
#include <optional>
#include <string_view>
#include <utility>

#include "server/store/checkpoint.hpp"

namespace shearbus::store {
namespace {

constexpr std::string_view kUnfinished = ".tmp";
constexpr std::string_view kSetAside = ".unused";
constexpr std::size_t kGenerationsKept = 2;

// Returns the number in a file name of this kind, or nothing for another name.
std::optional<std::uint64_t> number_in(std::string_view name, std::string_view prefix, std::string_view suffix) {
  if (!name.starts_with(prefix) || !name.ends_with(suffix) || name.size() <= prefix.size() + suffix.size()) return {};
  name.remove_prefix(prefix.size());
  name.remove_suffix(suffix.size());
  std::uint64_t number = 0;
  const auto [end, fault] = std::from_chars(name.data(), name.data() + name.size(), number);
  if (fault != std::errc() || end != name.data() + name.size()) return {};
  return number;
}

}  // namespace

const char* name(Durability durability) {
  switch (durability) {
    case Durability::kNone:
      return "none";
    case Durability::kProcess:
      return "process";
    case Durability::kPower:
      return "power";
  }
  return "?";
}

// The files of the directory by kind, each kind with ascending numbers.
struct Store::Found {
  std::vector<std::uint64_t> checkpoints;
  std::vector<std::uint64_t> segments;
  std::vector<std::uint64_t> capsules;
  std::vector<std::string> unfinished;
};

Store::Store(Storage& storage, StoreOptions options) : storage_(storage), options_(std::move(options)) {}

void Store::log(const std::string& line) const {
  if (options_.log) options_.log(line);
}

Store::Found Store::find() {
  Found found;
  for (const std::string& file : storage_.list()) {
    if (const auto generation = number_in(file, "checkpoint-", ".h5")) found.checkpoints.push_back(*generation);
    if (const auto number = number_in(file, "journal-", ".log")) found.segments.push_back(*number);
    if (const auto number = number_in(file, "capsule-", ".h5")) found.capsules.push_back(*number);
    if (file.ends_with(kUnfinished)) found.unfinished.push_back(file);
  }
  std::sort(found.checkpoints.begin(), found.checkpoints.end());
  std::sort(found.segments.begin(), found.segments.end());
  std::sort(found.capsules.begin(), found.capsules.end());
  return found;
}

void Store::recover(Recovery& recovery) {
  const Found found = find();
  for (const std::string& file : found.unfinished) storage_.remove(file);
  if (!found.checkpoints.empty()) next_generation_ = found.checkpoints.back() + 1;
  if (!found.segments.empty()) next_segment_ = found.segments.back() + 1;
  try {
    recover_from(found, recovery);
  } catch (const std::exception& fault) {
    recovery.clear();
    if (!options_.accept_empty) throw;
    log(std::string("the states on disk cannot be used: ") + fault.what());
    set_aside(found);
  }
  if (journaling()) start_segment();
}

void Store::recover_from(const Found& found, Recovery& recovery) {
  replay_segments(found, restore_newest(found, recovery), recovery);
}

// Returns the index of the first record that is not part of the restored checkpoint.
std::uint64_t Store::restore_newest(const Found& found, Recovery& recovery) {
  std::string faults;
  std::optional<Snapshot> newest;
  for (auto generation = found.checkpoints.rbegin(); generation != found.checkpoints.rend(); ++generation) {
    const std::string file = checkpoint_name(*generation);
    try {
      Snapshot snapshot = read_checkpoint(storage_.read(file), file, *generation);
      checkpoints_.insert(checkpoints_.begin(), {*generation, snapshot.next_index});
      if (!newest) newest = std::move(snapshot);
    } catch (const DamagedFile& fault) {
      log(std::string("DAMAGED checkpoint, not loaded: ") + fault.what());
      faults += (faults.empty() ? "" : "; ") + std::string(fault.what());
    }
  }
  if (!newest) {
    if (found.checkpoints.empty()) return 0;
    throw DamagedFile(
        "no checkpoint can be loaded: " + faults +
        ". Restore the files from a backup, or start with --accept-empty to set them aside and lose the states");
  }
  recovery.restore(*newest);
  log("restored " + checkpoint_name(checkpoints_.back().number) + ": " + std::to_string(newest->sessions.size()) +
      " sessions");
  return newest->next_index;
}

void Store::replay_segments(const Found& found, std::uint64_t base, Recovery& recovery) {
  next_index_ = base;
  std::string torn;  // name of the segment whose last record is incomplete
  for (const std::uint64_t number : found.segments) {
    const std::string file = segment_name(number);
    const std::vector<std::byte> bytes = storage_.read(file);
    const Segment segment = read_segment(bytes, file);
    if (!torn.empty() && !segment.records.empty())
      throw DamagedFile(torn + ": it ends in the middle of a record, and " + file + " goes on");
    if (segment.sound_bytes == 0) {
      storage_.remove(file);  // an incomplete header: the segment never held a record
      continue;
    }
    if (segment.number != number)
      throw DamagedFile(file + ": it is segment " + std::to_string(segment.number) + " under the name of another");
    if (segment.first_index > next_index_)
      throw DamagedFile(file + ": it begins with record " + std::to_string(segment.first_index) + "; records from " +
                        std::to_string(next_index_) + " on are missing");
    for (const Record& record : segment.records) {
      if (record.index < next_index_) continue;
      recovery.replay(record, segment.epoch);
      ++next_index_;
      ++counters_.replayed;
    }
    if (segment.torn) {
      torn = file;
      log(file + ": cut after its last whole record; a request that was never answered was being written");
      const auto opened = storage_.open(file);
      opened->truncate(segment.sound_bytes);
      opened->sync();
    }
    bytes_since_checkpoint_ += segment.sound_bytes;
    segments_.push_back({number, segment.first_index});
  }
  changed_ = counters_.replayed != 0;
  if (changed_) log("replayed " + std::to_string(counters_.replayed) + " requests from the journal");
}

void Store::set_aside(const Found& found) {
  const auto aside = [&](const std::string& file) { storage_.rename(file, file + std::string(kSetAside)); };
  for (const std::uint64_t generation : found.checkpoints) aside(checkpoint_name(generation));
  for (const std::string& file : storage_.list())
    if (number_in(file, "journal-", ".log")) aside(file);
  storage_.sync_directory();
  log("every file was renamed to *.unused; starting with no states");
  checkpoints_.clear();
  segments_.clear();
  next_index_ = 0;
  bytes_since_checkpoint_ = 0;
  counters_.replayed = 0;
  changed_ = false;
}

void Store::start_segment() {
  const std::uint64_t number = next_segment_++;  // never used again: a failed creation may leave a file
  journal_ = std::make_unique<JournalWriter>(storage_, number, options_.epoch, next_index_,
                                             options_.durability == Durability::kPower);
  segments_.push_back({number, next_index_});
}

void Store::append(const Record& record) {
  if (failed_) throw StorageError("the journal has failed before", EIO);
  changed_ = true;
  if (!journaling()) {
    bytes_since_checkpoint_ += record.header_frame.size() + record.payload_frame.size();
    return;
  }
  const std::uint64_t before = journal_->bytes();
  try {
    journal_->append(record);
  } catch (const StorageError&) {
    failed_ = journal_->broken();
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
  if (options_.durability != Durability::kPower) return;
  failed_ = true;
  journal_->sync();
  failed_ = false;
}

bool Store::checkpoint_due() const {
  return changed_ && !failed_ && bytes_since_checkpoint_ >= std::max(options_.checkpoint_bytes, retry_at_bytes_);
}

bool Store::checkpoint(Snapshot snapshot) {
  snapshot.next_index = next_index_;
  try {
    write_checkpoint(snapshot);
  } catch (const std::exception& fault) {
    ++counters_.checkpoints_failed;
    // After a failure a file with this generation may exist with unknown contents, so the number is not reused.
    ++next_generation_;
    retry_at_bytes_ = bytes_since_checkpoint_ + options_.checkpoint_bytes / 8 + 1;
    log(std::string("the checkpoint could not be written: ") + fault.what() +
        "; the ones before and the journal hold everything");
    return false;
  }
  bytes_since_checkpoint_ = 0;
  retry_at_bytes_ = 0;
  changed_ = false;
  ++counters_.checkpoints;
  try {
    if (journaling() && journal_->next_index() != journal_->first_index()) start_segment();
    prune();
  } catch (const std::exception& fault) {
    log(std::string("old files could not be put away: ") + fault.what());
  }
  return true;
}

void Store::write_checkpoint(const Snapshot& snapshot) {
  const std::uint64_t generation = next_generation_;
  const std::string file = checkpoint_name(generation);
  const std::string unfinished = file + std::string(kUnfinished);
  const std::vector<std::byte> bytes = checkpoint_bytes(snapshot, generation);
  try {
    const auto opened = storage_.create(unfinished);
    const std::array<Bytes, 1> parts = {Bytes(bytes)};
    opened->append(parts);
    opened->sync();
  } catch (const std::exception&) {
    try {
      storage_.remove(unfinished);
    } catch (const std::exception&) {
      // The next recovery removes the unfinished file.
    }
    throw;
  }
  storage_.rename(unfinished, file);
  storage_.sync_directory();
  const Bytes image = verified_image(storage_.read(file), file, generation);
  counters_.checkpoint_bytes = image.size() + sizeof(CheckpointFooter);
  checkpoints_.push_back({generation, snapshot.next_index});
  ++next_generation_;
}

std::size_t Store::capsule_room() {
  return options_.max_capsules - std::min(options_.max_capsules, find().capsules.size());
}

std::string Store::leave_capsule(const Capsule& capsule) {
  const auto there = find().capsules;
  const std::string file = capsule_name(there.empty() ? 1 : there.back() + 1);
  const std::vector<std::byte> bytes = capsule_bytes(capsule);
  const std::array<Bytes, 1> parts = {Bytes(bytes)};
  storage_.create(file + std::string(kUnfinished))->append(parts);
  storage_.rename(file + std::string(kUnfinished), file);
  return file;
}

// Keeps the newest kGenerationsKept sound checkpoints and every segment with a record later than the oldest of them.
// Older checkpoints are removed, including damaged ones and the files of failed attempts. Their removal is durable
// before the first segment is removed, because a checkpoint without the later segments cannot be used.
void Store::prune() {
  if (checkpoints_.size() > kGenerationsKept)
    checkpoints_.erase(checkpoints_.begin(), checkpoints_.end() - kGenerationsKept);
  if (checkpoints_.size() < kGenerationsKept) return;
  for (const std::uint64_t generation : find().checkpoints)
    if (generation < checkpoints_.front().number) storage_.remove(checkpoint_name(generation));
  storage_.sync_directory();
  while (segments_.size() > 1 && segments_[1].index <= checkpoints_.front().index) {
    storage_.remove(segment_name(segments_.front().number));
    segments_.erase(segments_.begin());
  }
}

}  // namespace shearbus::store
