#include "server/store/left_out.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "proto/wire/text.hpp"
#include "server/store/checkpoint.hpp"

namespace shearbus::store {
namespace {

constexpr std::size_t kFewestDigits = 8;

}  // namespace

LeftOut::LeftOut(LeaveOut what) : what_(std::move(what)) {
  for (const std::string& digits : what_.sessions)
    if (digits.size() < kFewestDigits || digits.size() > 2 * SessionKey().size() ||
        digits.find_first_not_of("0123456789abcdef") != std::string::npos)
      throw std::invalid_argument("session \"" + digits +
                                  "\" cannot be left out: expected the first 8 to 32 hexadecimal digits of its id");
}

bool LeftOut::names(const SessionKey& session) {
  const std::string id = hexadecimal(session);
  bool named = cut_.contains(session);
  for (const std::string& digits : what_.sessions)
    if (id.starts_with(digits)) {
      found_[digits].insert(session);
      named = true;
    }
  return named;
}

void LeftOut::take(Snapshot& snapshot) {
  const auto staying = std::stable_partition(snapshot.sessions.begin(), snapshot.sessions.end(),
                                             [&](const SessionImage& session) { return names(session.id); });
  sessions_.server_version = snapshot.server_version;
  sessions_.next_index = snapshot.next_index;
  std::move(snapshot.sessions.begin(), staying, std::back_inserter(sessions_.sessions));
  snapshot.sessions.erase(snapshot.sessions.begin(), staying);
  for (const PendingRequest& request : snapshot.pending)
    if (names(request.session)) sessions_.pending.push_back(request);
  std::erase_if(snapshot.pending, [&](const PendingRequest& request) { return names(request.session); });
}

bool LeftOut::take(const Record& record) {
  if (std::ranges::find(what_.records, record.index) != what_.records.end()) {
    found_records_.insert(record.index);
    cut_.insert(record.session);
  }
  if (!names(record.session)) return false;
  records_.push_back({.session = record.session,
                      .sequence = record.sequence,
                      .previous_reply = record.previous_reply,
                      .header_frame = {record.header_frame.begin(), record.header_frame.end()},
                      .payload_frame = {record.payload_frame.begin(), record.payload_frame.end()},
                      .identity = std::string(record.identity)});
  return true;
}

void LeftOut::check_found() const {
  for (const std::string& digits : what_.sessions) {
    const auto found = found_.find(digits);
    if (found == found_.end())
      throw std::invalid_argument("session " + digits +
                                  " cannot be left out: the state directory holds none of this id");
    if (found->second.size() > 1)
      throw std::invalid_argument(
          fmt::format("session {} cannot be left out: {} sessions begin with these digits; give more of them", digits,
                      found->second.size()));
  }
  for (const std::uint64_t record : what_.records)
    if (!found_records_.contains(record))
      throw std::invalid_argument(
          fmt::format("record {} cannot be left out: the journal since the last checkpoint does not hold it", record));
}

std::string LeftOut::set_aside(Storage& storage, const StoreId& store) const {
  std::uint64_t number = 1;
  for (const std::string& file : storage.list())
    for (; file.starts_with(numbered("dropped-", number, ".")); ++number) {
    }
  std::string files;
  if (!sessions_.sessions.empty()) {
    Snapshot snapshot = sessions_;
    snapshot.store = store;
    const std::string name = numbered("dropped-", number, ".h5");
    const std::vector<std::byte> bytes = checkpoint_bytes(snapshot, number);
    const std::array<Bytes, 1> parts = {bytes};
    const auto file = storage.create(name);
    file->append(parts);
    file->sync();
    files = name;
  }
  if (!records_.empty()) {
    const std::string name = numbered("dropped-", number, ".log");
    JournalWriter journal(storage, name, {.number = number, .store = store}, true);
    for (const Kept& record : records_)
      journal.append({.session = record.session,
                      .sequence = record.sequence,
                      .previous_reply = record.previous_reply,
                      .header_frame = record.header_frame,
                      .payload_frame = record.payload_frame,
                      .identity = record.identity});
    journal.settle();
    files += (files.empty() ? "" : " and ") + name;
  }
  storage.sync_directory();
  return fmt::format("dropped: {} of the checkpoint and {} of the journal, set aside in {}",
                     wire::counted(sessions_.sessions.size(), "session"), wire::counted(records_.size(), "request"),
                     files);
}

}  // namespace shearbus::store
