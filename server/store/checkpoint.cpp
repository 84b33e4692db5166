#include "server/store/checkpoint.hpp"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <iterator>
#include <span>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "proto/files/record_file.hpp"
#include "server/store/hdf5_fields.hpp"

namespace shearbus::store {
namespace {

constexpr const char* kFormat = "shearbus checkpoint";

std::array<std::uint64_t, 2> sum_of_image(Bytes image) {
  const XXH128_hash_t sum = XXH3_128bits(image.data(), image.size());
  return {sum.low64, sum.high64};
}

std::string mark_name(std::uint64_t number) {
  return "mark_" + std::to_string(number);
}

// Refuses states that are not those of all nodes, in the order of their ids.
void check_rows(const shard::States& states, const std::vector<std::uint64_t>& node_ids, const std::string& name) {
  std::size_t row = 0;
  if (states.rows.size() != node_ids.size() ||
      !std::ranges::all_of(states.rows, [&](std::uint32_t slot) { return slot == row++; }))
    throw hdf5::Error(fmt::format("find the slots of all {} nodes in their order in {}", node_ids.size(), name));
}

}  // namespace

SessionKey key_from(const std::string& text) {
  SessionKey key{};
  bool read = text.size() == 2 * key.size();
  for (std::size_t i = 0; read && i < key.size(); ++i) {
    const char* const end = text.data() + 2 * i + 2;
    read = std::from_chars(end - 2, end, key[i], 16).ptr == end;
  }
  if (!read || text != hexadecimal(key)) throw hdf5::Error("take \"" + text + "\" for an id");
  return key;
}

std::vector<std::string> words_of(const std::string& text) {
  std::istringstream words(text);
  return {std::istream_iterator<std::string>(words), {}};
}

void put(hid_t parent, const std::string& name, const shard::States& states) {
  const hdf5::Group group = hdf5::make_group(parent, name);
  put_numbers(group, "slot", states.rows, states.rows.size());
  // The attribute keeps the order of the columns: HDF5 lists the members of a group by name.
  std::string names;
  for (const shard::StateColumn& column : states.columns) {
    names += (names.empty() ? "" : " ") + column.name;
    const hdf5::Dataset dataset = put_numbers(group, column.name, column.values, states.rows.size(), column.width);
    hdf5::put_text(dataset, "units", column.units);
  }
  hdf5::put_text(group, "columns", names);
}

void get(hid_t parent, const std::string& name, shard::States& states) {
  const hdf5::Group group = hdf5::open_group(parent, name);
  states = {.rows = numbers_of<std::uint32_t>(group, "slot")};
  for (const std::string& name_of_column : words_of(text_of(group, "columns"))) {
    shard::StateColumn column{.name = name_of_column};
    column.values = numbers_of<double>(group, column.name, &column.width);
    if (column.values.size() != states.rows.size() * column.width)
      throw hdf5::Error("find a row for each slot in dataset " + column.name);
    column.units = text_of(hdf5::open_dataset(group, column.name), "units");
    states.columns.push_back(std::move(column));
  }
}

void put(hid_t group, const std::string& name, const std::vector<MarkImage>& marks) {
  put_number(group, name, marks.size());
  for (std::size_t i = 0; i < marks.size(); ++i) put_fields(hdf5::make_group(group, mark_name(i)), marks[i]);
}

void get(hid_t group, const std::string& name, std::vector<MarkImage>& marks) {
  for (std::uint64_t i = 0, count = number_of(group, name); i < count; ++i) {
    MarkImage& mark = marks.emplace_back();
    get_fields(hdf5::open_group(group, mark_name(i)), mark);
    check_rows(mark.states, mark.node_ids, "states");
  }
}

namespace {

SessionImage session_of(hid_t parent, const std::string& name, std::uint64_t& order) {
  const hdf5::Group group = hdf5::open_group(parent, name);
  SessionImage session;
  session.id = key_from(name);
  order = number_of(group, "order");
  get_fields(group, session);
  check_rows(session.committed, session.node_ids, "committed");
  if (!session.before_header.empty() && session.last_sequence < 2)
    throw hdf5::Error(fmt::format("find a step before request {}", session.last_sequence));
  for (const std::uint32_t row : session.part_rows)
    if (row >= session.node_ids.size()) throw hdf5::Error(fmt::format("find node {} of part_rows", row));
  return session;
}

// Closed sessions are many and small, so each of their quantities is one dataset.
constexpr std::pair<const char*, std::uint64_t SessionImage::*> kNumbersOfClosed[] = {
    {"last_sequence", &SessionImage::last_sequence},
    {"last_request_xxh3", &SessionImage::last_hash},
    {"requests", &SessionImage::requests},
    {"node_steps", &SessionImage::node_steps},
    {"solver_ns", &SessionImage::solver_ns}};

void put_closed(hid_t parent, const std::vector<const SessionImage*>& sessions) {
  const hdf5::Group group = hdf5::make_group(parent, "closed");
  const std::size_t rows = sessions.size();
  std::vector<std::uint8_t> ids;
  std::vector<std::byte> headers;
  std::string identities;  // a line for each, in the order of their first session
  const std::string* last = nullptr;
  std::uint64_t lines = 0;
  std::vector<std::uint64_t> identity, header_end;
  for (const SessionImage* session : sessions) {
    ids.insert(ids.end(), session->id.begin(), session->id.end());
    if (last == nullptr || *last != session->identity) {
      last = &session->identity;
      identities += *last + "\n";
      ++lines;
    }
    identity.push_back(lines - 1);
    headers.insert(headers.end(), session->reply_header.begin(), session->reply_header.end());
    header_end.push_back(headers.size());
  }
  put_text_dataset(group, "identities", identities);
  put_numbers(group, "id", ids, rows, ids.size() / rows);
  put(group, "identity", identity);
  for (const auto& [name, member] : kNumbersOfClosed) {
    std::vector<std::uint64_t> numbers;
    for (const SessionImage* session : sessions) numbers.push_back(session->*member);
    put(group, name, numbers);
  }
  put(group, "reply_header", headers);
  put(group, "reply_header_end", header_end);
}

std::vector<SessionImage> closed_in(hid_t parent) {
  if (!hdf5::has_child(parent, "closed")) return {};
  const hdf5::Group group = hdf5::open_group(parent, "closed");
  std::vector<std::string> identities;
  std::istringstream lines(text_in_dataset(group, "identities"));
  for (std::string line; std::getline(lines, line);) identities.push_back(line);
  const auto ids = numbers_of<std::uint8_t>(group, "id");
  const auto headers = numbers_of<std::byte>(group, "reply_header");
  const auto identity = numbers_of<std::uint64_t>(group, "identity");
  const auto header_end = numbers_of<std::uint64_t>(group, "reply_header_end");
  std::vector<SessionImage> sessions(identity.size());
  for (const auto& [name, member] : kNumbersOfClosed) {
    const auto numbers = numbers_of<std::uint64_t>(group, name);
    for (std::size_t i = 0; i < sessions.size(); ++i) sessions[i].*member = numbers.at(i);
  }
  std::uint64_t begin = 0;
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    SessionImage& session = sessions[i];
    const std::uint64_t end = header_end.at(i);
    if (begin > end || end > headers.size() || (i + 1) * session.id.size() > ids.size())
      throw hdf5::Error("find the closed sessions");
    std::copy_n(ids.begin() + static_cast<std::ptrdiff_t>(i * session.id.size()), session.id.size(),
                session.id.begin());
    session.open = false;
    session.identity = identities.at(identity[i]);
    session.reply_header.assign(headers.begin() + static_cast<std::ptrdiff_t>(begin),
                                headers.begin() + static_cast<std::ptrdiff_t>(end));
    begin = end;
  }
  return sessions;
}

TransferImage transfer_of(hid_t parent, const std::string& name) {
  TransferImage transfer{.id = key_from(name)};
  get_fields(hdf5::open_group(parent, name), transfer);
  check_rows(transfer.states, transfer.node_ids, "states");
  return transfer;
}

}  // namespace

std::vector<std::byte> checkpoint_bytes(const Snapshot& snapshot, std::uint64_t generation) {
  const hdf5::Quiet quiet;
  const hdf5::File file = new_image();
  hdf5::put_text(file, "format", kFormat);
  put_number(file, "format_version", kCheckpointVersion);
  hdf5::put_text(file, "server_version", snapshot.server_version);
  hdf5::put_text(file, "units_system", "SI");
  put_number(file, "generation", generation);
  put_number(file, "next_index", snapshot.next_index);
  {
    const hdf5::Group sessions = hdf5::make_group(file, "sessions");
    std::vector<const SessionImage*> closed;
    std::uint64_t order = 0;
    for (const SessionImage& session : snapshot.sessions)
      if (session.open) {
        const hdf5::Group group = hdf5::make_group(sessions, hexadecimal(session.id));
        put_number(group, "order", order++);
        put_fields(group, session);
      } else {
        closed.push_back(&session);
      }
    if (!closed.empty()) put_closed(file, closed);
    const hdf5::Group transfers = hdf5::make_group(file, "transfers");
    for (const TransferImage& transfer : snapshot.transfers)
      put_fields(hdf5::make_group(transfers, hexadecimal(transfer.id)), transfer);
    if (!snapshot.pending.empty()) {
      const hdf5::Group pending = hdf5::make_group(file, "pending");
      for (std::size_t i = 0; i < snapshot.pending.size(); ++i)
        put_fields(hdf5::make_group(pending, std::to_string(i)), snapshot.pending[i]);
    }
  }
  std::vector<std::byte> bytes = bytes_of_image(file);
  CheckpointFooter footer{
      .image_bytes = bytes.size(), .generation = generation, .image_sum = sum_of_image(bytes), .store = snapshot.store};
  footer.sum = files::sum_of_header(footer);
  const Bytes end = std::as_bytes(std::span(&footer, 1));
  bytes.insert(bytes.end(), end.begin(), end.end());
  return bytes;
}

Bytes verified_image(Bytes file, const std::string& name, std::uint64_t generation) {
  const auto damaged = [&](const std::string& what) -> DamagedFile { return DamagedFile(name + ": " + what); };
  CheckpointFooter footer;
  if (file.size() < sizeof footer) throw damaged("too short to be a checkpoint");
  std::memcpy(&footer, file.data() + file.size() - sizeof footer, sizeof footer);
  if (footer.magic != kCheckpointMagic)
    throw damaged("it does not end with a checkpoint's mark: it was cut, or is something else");
  if (footer.version != kCheckpointVersion)
    throw damaged(
        fmt::format("checkpoint version {}; this server reads version {}", footer.version, kCheckpointVersion));
  if (footer.sum != files::sum_of_header(footer)) throw damaged("its footer does not match its sum");
  if (footer.image_bytes != file.size() - sizeof footer) throw damaged("its length is not what its footer says");
  if (footer.generation != generation)
    throw damaged(fmt::format("it is generation {} under the name of another", footer.generation));
  const Bytes image = file.first(footer.image_bytes);
  if (footer.image_sum != sum_of_image(image)) throw damaged("its bytes do not match their hash");
  return image;
}

Snapshot read_checkpoint(Bytes file, const std::string& name, std::uint64_t generation) {
  const Bytes image = verified_image(file, name, generation);
  try {
    const hdf5::Quiet quiet;
    const hdf5::File opened = open_image(image);
    Snapshot snapshot;
    CheckpointFooter footer;
    std::memcpy(&footer, file.data() + file.size() - sizeof footer, sizeof footer);
    snapshot.store = footer.store;
    if (text_of(opened, "format") != kFormat || number_of(opened, "format_version") != kCheckpointVersion)
      throw hdf5::Error("find the format it was written for");
    snapshot.server_version = text_of(opened, "server_version");
    snapshot.next_index = number_of(opened, "next_index");
    const hdf5::Group sessions = hdf5::open_group(opened, "sessions");
    const auto names = hdf5::children_of(sessions);
    snapshot.sessions = closed_in(opened);
    const std::size_t closed = snapshot.sessions.size();
    snapshot.sessions.resize(closed + names.size());
    for (const std::string& child : names) {
      std::uint64_t order = 0;
      SessionImage session = session_of(sessions, child, order);
      if (order >= names.size()) throw hdf5::Error("order the sessions");
      snapshot.sessions[closed + order] = std::move(session);
    }
    const hdf5::Group transfers = hdf5::open_group(opened, "transfers");
    for (const std::string& child : hdf5::children_of(transfers))
      snapshot.transfers.push_back(transfer_of(transfers, child));
    if (hdf5::has_child(opened, "pending")) {
      const hdf5::Group pending = hdf5::open_group(opened, "pending");
      const std::size_t count = hdf5::children_of(pending).size();
      for (std::size_t i = 0; i < count; ++i)
        get_fields(hdf5::open_group(pending, std::to_string(i)), snapshot.pending.emplace_back());
    }
    return snapshot;
  } catch (const hdf5::Error& fault) {
    throw DamagedFile(name + ": its hash is right, but " + fault.what());
  } catch (const std::out_of_range&) {
    throw DamagedFile(name + ": its hash is right, but its lists of closed sessions have unequal lengths");
  }
}

namespace {

constexpr const char* kCapsuleFormat = "shearbus failure capsule";

}  // namespace

void put(hid_t parent, const std::string& name, const std::vector<CapsuleValue>& values) {
  const hdf5::Group group = hdf5::make_group(parent, name);
  std::string names;
  for (const CapsuleValue& value : values) {
    names += (names.empty() ? "" : " ") + value.name;
    put_numbers(group, value.name, std::vector<double>{value.value}, 1);
  }
  hdf5::put_text(group, "columns", names);
}

void get(hid_t parent, const std::string& name, std::vector<CapsuleValue>& values) {
  const hdf5::Group group = hdf5::open_group(parent, name);
  for (const std::string& column : words_of(text_of(group, "columns"))) {
    values.push_back({.name = column});
    get(group, column, values.back().value);
  }
}

std::vector<std::byte> capsule_bytes(const Capsule& capsule) {
  const hdf5::Quiet quiet;
  const hdf5::File file = new_image();
  hdf5::put_text(file, "format", kCapsuleFormat);
  put_number(file, "format_version", kCapsuleVersion);
  hdf5::put_text(file, "units_system", "SI");
  put_fields(file, capsule);
  return bytes_of_image(file);
}

Capsule read_capsule(Bytes file, const std::string& name) try {
  const hdf5::Quiet quiet;
  const hdf5::File opened = open_image(file);
  if (text_of(opened, "format") != kCapsuleFormat || number_of(opened, "format_version") != kCapsuleVersion)
    throw hdf5::Error(fmt::format("find the format \"{}\", version {}", kCapsuleFormat, kCapsuleVersion));
  Capsule capsule;
  get_fields(opened, capsule);
  return capsule;
} catch (const hdf5::Error& fault) {
  throw DamagedFile(name + ": not a failure capsule that can be read: " + fault.what());
}

}  // namespace shearbus::store
