#include "server/store/checkpoint.hpp"

#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <stdexcept>

#include "server/store/hdf5_image.hpp"

namespace shearbus::store {
namespace {

constexpr const char* kFormat = "shearbus checkpoint";

std::array<std::uint64_t, 2> sum_of_image(Bytes image) {
  const XXH128_hash_t sum = XXH3_128bits(image.data(), image.size());
  return {sum.low64, sum.high64};
}

std::uint64_t sum_of_footer(const CheckpointFooter& footer) {
  return XXH3_64bits(&footer, offsetof(CheckpointFooter, sum));
}

SessionKey key_from(const std::string& text) {
  const auto digit = [&](char c) -> unsigned {
    if (c >= '0' && c <= '9') return static_cast<unsigned>(c - '0');
    if (c >= 'a' && c <= 'f') return static_cast<unsigned>(c - 'a' + 10);
    throw Hdf5Error("take \"" + text + "\" for an id");
  };
  SessionKey key{};
  if (text.size() != 2 * key.size()) throw Hdf5Error("take \"" + text + "\" for an id");
  for (std::size_t i = 0; i < key.size(); ++i)
    key[i] = static_cast<std::uint8_t>(digit(text[2 * i]) << 4 | digit(text[2 * i + 1]));
  return key;
}

std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find(' ', begin), text.size());
    words.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return words;
}

void put_states(hid_t parent, const std::string& name, const shard::States& states) {
  const hdf5::Group group = make_group(parent, name);
  put_numbers(group, "slot", states.rows, states.rows.size());
  // The attribute keeps the order of the columns: HDF5 lists the members of a group by name.
  std::string names;
  for (const shard::StateColumn& column : states.columns) {
    names += (names.empty() ? "" : " ") + column.name;
    const hdf5::Dataset dataset = put_numbers(group, column.name, column.values, states.rows.size(), column.width);
    put_text(dataset, "units", column.units);
  }
  put_text(group, "columns", names);
}

shard::States states_of(hid_t parent, const std::string& name) {
  const hdf5::Group group = open_group(parent, name);
  shard::States states{.rows = numbers_of<std::uint32_t>(group, "slot"), .columns = {}};
  for (const std::string& name_of_column : words_of(text_of(group, "columns"))) {
    shard::StateColumn column{.name = name_of_column, .units = {}, .width = 0, .values = {}};
    column.values = numbers_of<double>(group, column.name, &column.width);
    if (column.values.size() != states.rows.size() * column.width)
      throw Hdf5Error("find a row for each slot in dataset " + column.name);
    column.units = text_of(open_dataset(group, column.name, hdf5_type<double>()), "units");
    states.columns.push_back(std::move(column));
  }
  return states;
}

// Those of all nodes, in the order of their ids.
shard::States states_of_all(hid_t parent, const std::string& name, const std::vector<std::uint64_t>& node_ids) {
  shard::States states = states_of(parent, name);
  std::size_t row = 0;
  if (states.rows.size() != node_ids.size() ||
      !std::ranges::all_of(states.rows, [&](std::uint32_t slot) { return slot == row++; }))
    throw Hdf5Error("find the slots of all " + std::to_string(node_ids.size()) + " nodes in their order in " + name);
  return states;
}

std::string mark_name(std::uint64_t number) {
  return "mark_" + std::to_string(number);
}

void put_ids(hid_t group, const std::vector<std::uint64_t>& node_ids) {
  put_numbers(group, "node_id", node_ids, node_ids.size());
}

std::vector<std::uint64_t> ids_of(hid_t group) {
  return numbers_of<std::uint64_t>(group, "node_id");
}

void put_session(hid_t parent, const SessionImage& session, std::uint64_t order) {
  const hdf5::Group group = make_group(parent, hexadecimal(session.id));
  put_number(group, "order", order);
  put_number(group, "last_sequence", session.last_sequence);
  put_number(group, "last_request_xxh3", session.last_hash);
  put_number(group, "requests", session.requests);
  put_number(group, "node_steps", session.node_steps);
  put_number(group, "solver_ns", session.solver_ns);
  if (session.owner_epoch != 0) put_number(group, "owner_epoch", session.owner_epoch);
  if (session.claim != 0) {
    put_number(group, "claim", session.claim);
    put_number(group, "claimant", session.claimant);
    put_numbers(group, "superseded_epochs", session.superseded, session.superseded.size());
  }
  put_text(group, "identity", session.identity);
  put_text(group, "resume_token", hexadecimal(session.resume_token));
  put_text(group, "domain", session.domain);
  if (session.idle_limit_s != 0) put_number(group, "idle_limit_s", session.idle_limit_s);
  put_numbers(group, "reply_header", session.reply_header, session.reply_header.size());
  put_numbers(group, "reply_payload", session.reply_payload, session.reply_payload.size());
  if (!session.before_header.empty()) {
    put_number(group, "request_before_xxh3", session.before_hash);
    put_numbers(group, "reply_before_header", session.before_header, session.before_header.size());
    put_numbers(group, "reply_before_payload", session.before_payload, session.before_payload.size());
  }
  put_number(group, "state_version", session.state_version);
  put_text_dataset(group, "scene_toml", session.scene);  // not an attribute, which holds at most 64 kB
  put_ids(group, session.node_ids);
  put_states(group, "committed", session.committed);
  if (session.trial) put_states(group, "trial", *session.trial);
  if (!session.part_header.empty()) {
    put_numbers(group, "part_header", session.part_header, session.part_header.size());
    put_numbers(group, "part_rows", session.part_rows, session.part_rows.size());
  }
  put_number(group, "marks", session.marks.size());
  for (std::size_t i = 0; i < session.marks.size(); ++i) {
    const hdf5::Group mark = make_group(group, mark_name(i));
    put_text(mark, "name", session.marks[i].name);
    put_number(mark, "sequence", session.marks[i].sequence);
    put_number(mark, "state_version", session.marks[i].state_version);
    put_ids(mark, session.marks[i].node_ids);
    put_states(mark, "states", session.marks[i].states);
  }
}

SessionImage session_of(hid_t parent, const std::string& name, std::uint64_t& order) {
  const hdf5::Group group = open_group(parent, name);
  SessionImage session;
  session.id = key_from(name);
  order = number_of(group, "order");
  session.last_sequence = number_of(group, "last_sequence");
  session.last_hash = number_of(group, "last_request_xxh3");
  session.requests = number_of(group, "requests");
  session.node_steps = number_of(group, "node_steps");
  session.solver_ns = number_of(group, "solver_ns");
  session.identity = text_of(group, "identity");
  session.resume_token = key_from(text_of(group, "resume_token"));
  session.domain = text_of(group, "domain");
  if (has_attribute(group, "idle_limit_s")) session.idle_limit_s = number_of(group, "idle_limit_s");
  if (has_attribute(group, "owner_epoch")) session.owner_epoch = number_of(group, "owner_epoch");
  if (has_attribute(group, "claim")) {
    session.claim = number_of(group, "claim");
    session.claimant = number_of(group, "claimant");
    session.superseded = numbers_of<std::uint64_t>(group, "superseded_epochs");
  }
  session.reply_header = numbers_of<std::byte>(group, "reply_header");
  session.reply_payload = numbers_of<std::byte>(group, "reply_payload");
  if (has_child(group, "reply_before_header")) {
    if (session.last_sequence < 2)
      throw Hdf5Error("find a step before request " + std::to_string(session.last_sequence));
    session.before_hash = number_of(group, "request_before_xxh3");
    session.before_header = numbers_of<std::byte>(group, "reply_before_header");
    session.before_payload = numbers_of<std::byte>(group, "reply_before_payload");
  }
  session.state_version = number_of(group, "state_version");
  session.scene = text_in_dataset(group, "scene_toml");
  session.node_ids = ids_of(group);
  session.committed = states_of_all(group, "committed", session.node_ids);
  if (has_child(group, "trial")) session.trial = states_of(group, "trial");
  if (has_child(group, "part_header")) {
    session.part_header = numbers_of<std::byte>(group, "part_header");
    session.part_rows = numbers_of<std::uint32_t>(group, "part_rows");
    for (const std::uint32_t row : session.part_rows)
      if (row >= session.node_ids.size()) throw Hdf5Error("find node " + std::to_string(row) + " of part_rows");
  }
  for (std::uint64_t i = 0, marks = number_of(group, "marks"); i < marks; ++i) {
    const hdf5::Group mark = open_group(group, mark_name(i));
    std::vector<std::uint64_t> node_ids = ids_of(mark);
    shard::States states = states_of_all(mark, "states", node_ids);
    session.marks.push_back({.name = text_of(mark, "name"),
                             .sequence = number_of(mark, "sequence"),
                             .state_version = number_of(mark, "state_version"),
                             .node_ids = std::move(node_ids),
                             .states = std::move(states)});
  }
  return session;
}

// Closed sessions are many and small, so each of their quantities is one dataset.
void put_closed(hid_t parent, const std::vector<const SessionImage*>& sessions) {
  const hdf5::Group group = make_group(parent, "closed");
  const std::size_t rows = sessions.size();
  std::vector<std::uint8_t> ids;
  std::vector<std::byte> headers;
  std::string identities;  // a line for each, in the order of their first session
  std::vector<std::string> known;
  std::vector<std::uint64_t> identity, sequence, hash, requests, node_steps, solver_ns, header_end;
  for (const SessionImage* closed : sessions) {
    const SessionImage& session = *closed;
    ids.insert(ids.end(), session.id.begin(), session.id.end());
    if (known.empty() || known.back() != session.identity) {
      known.push_back(session.identity);
      identities += session.identity + "\n";
    }
    identity.push_back(known.size() - 1);
    sequence.push_back(session.last_sequence);
    hash.push_back(session.last_hash);
    requests.push_back(session.requests);
    node_steps.push_back(session.node_steps);
    solver_ns.push_back(session.solver_ns);
    headers.insert(headers.end(), session.reply_header.begin(), session.reply_header.end());
    header_end.push_back(headers.size());
  }
  put_text_dataset(group, "identities", identities);
  put_numbers(group, "id", ids, rows, ids.size() / rows);
  put_numbers(group, "identity", identity, rows);
  put_numbers(group, "last_sequence", sequence, rows);
  put_numbers(group, "last_request_xxh3", hash, rows);
  put_numbers(group, "requests", requests, rows);
  put_numbers(group, "node_steps", node_steps, rows);
  put_numbers(group, "solver_ns", solver_ns, rows);
  put_numbers(group, "reply_header", headers, headers.size());
  put_numbers(group, "reply_header_end", header_end, rows);
}

std::vector<SessionImage> closed_in(hid_t parent) {
  if (!has_child(parent, "closed")) return {};
  const hdf5::Group group = open_group(parent, "closed");
  std::vector<std::string> identities;
  const std::string lines = text_in_dataset(group, "identities");
  for (std::size_t begin = 0, end = 0; (end = lines.find('\n', begin)) != std::string::npos; begin = end + 1)
    identities.push_back(lines.substr(begin, end - begin));
  const auto ids = numbers_of<std::uint8_t>(group, "id");
  const auto headers = numbers_of<std::byte>(group, "reply_header");
  const auto number = [&](const char* name) { return numbers_of<std::uint64_t>(group, name); };
  const auto identity = number("identity"), sequence = number("last_sequence"), hash = number("last_request_xxh3"),
             requests = number("requests"), node_steps = number("node_steps"), solver_ns = number("solver_ns"),
             header_end = number("reply_header_end");
  std::vector<SessionImage> sessions(identity.size());
  std::uint64_t begin = 0;
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    SessionImage& session = sessions[i];
    const std::uint64_t end = header_end.at(i);
    if (begin > end || end > headers.size() || (i + 1) * session.id.size() > ids.size())
      throw Hdf5Error("find the closed sessions");
    std::copy_n(ids.begin() + static_cast<std::ptrdiff_t>(i * session.id.size()), session.id.size(),
                session.id.begin());
    session.open = false;
    session.identity = identities.at(identity[i]);
    session.last_sequence = sequence.at(i);
    session.last_hash = hash.at(i);
    session.requests = requests.at(i);
    session.node_steps = node_steps.at(i);
    session.solver_ns = solver_ns.at(i);
    session.reply_header.assign(headers.begin() + static_cast<std::ptrdiff_t>(begin),
                                headers.begin() + static_cast<std::ptrdiff_t>(end));
    begin = end;
  }
  return sessions;
}

void put_transfer(hid_t parent, const TransferImage& transfer) {
  const hdf5::Group group = make_group(parent, hexadecimal(transfer.id));
  put_text(group, "giver", hexadecimal(transfer.giver));
  put_number(group, "sequence", transfer.sequence);
  put_text(group, "identity", transfer.identity);
  put_text(group, "domain", transfer.domain);
  put_text_dataset(group, "layers_toml", transfer.layers);
  put_ids(group, transfer.node_ids);
  put_states(group, "states", transfer.states);
}

TransferImage transfer_of(hid_t parent, const std::string& name) {
  const hdf5::Group group = open_group(parent, name);
  std::vector<std::uint64_t> node_ids = ids_of(group);
  shard::States states = states_of_all(group, "states", node_ids);
  return {.id = key_from(name),
          .giver = key_from(text_of(group, "giver")),
          .sequence = number_of(group, "sequence"),
          .identity = text_of(group, "identity"),
          .domain = text_of(group, "domain"),
          .layers = text_in_dataset(group, "layers_toml"),
          .node_ids = std::move(node_ids),
          .states = std::move(states)};
}

void put_pending(hid_t parent, const PendingRequest& request, std::uint64_t order) {
  const hdf5::Group group = make_group(parent, std::to_string(order));
  put_text(group, "session", hexadecimal(request.session));
  put_number(group, "epoch", request.epoch);
  put_number(group, "previous_committed", request.previous_committed ? 1 : 0);
  put_numbers(group, "header_frame", request.header_frame, request.header_frame.size());
  put_numbers(group, "payload_frame", request.payload_frame, request.payload_frame.size());
}

PendingRequest pending_of(hid_t parent, std::uint64_t order) {
  const hdf5::Group group = open_group(parent, std::to_string(order));
  return {.session = key_from(text_of(group, "session")),
          .epoch = number_of(group, "epoch"),
          .previous_committed = number_of(group, "previous_committed") != 0,
          .header_frame = numbers_of<std::byte>(group, "header_frame"),
          .payload_frame = numbers_of<std::byte>(group, "payload_frame")};
}

}  // namespace

std::vector<std::byte> checkpoint_bytes(const Snapshot& snapshot, std::uint64_t generation) {
  const hdf5::File file = new_image();
  put_text(file, "format", kFormat);
  put_number(file, "format_version", kCheckpointVersion);
  put_text(file, "server_version", snapshot.server_version);
  put_text(file, "units_system", "SI");
  put_number(file, "generation", generation);
  put_number(file, "next_index", snapshot.next_index);
  {
    const hdf5::Group sessions = make_group(file, "sessions");
    std::vector<const SessionImage*> closed;
    std::uint64_t order = 0;
    for (const SessionImage& session : snapshot.sessions)
      if (session.open)
        put_session(sessions, session, order++);
      else
        closed.push_back(&session);
    if (!closed.empty()) put_closed(file, closed);
    const hdf5::Group transfers = make_group(file, "transfers");
    for (const TransferImage& transfer : snapshot.transfers) put_transfer(transfers, transfer);
    if (!snapshot.pending.empty()) {
      const hdf5::Group pending = make_group(file, "pending");
      for (std::size_t i = 0; i < snapshot.pending.size(); ++i) put_pending(pending, snapshot.pending[i], i);
    }
  }
  std::vector<std::byte> bytes = bytes_of_image(file);
  CheckpointFooter footer{
      .image_bytes = bytes.size(), .generation = generation, .image_sum = sum_of_image(bytes), .store = snapshot.store};
  footer.sum = sum_of_footer(footer);
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
    throw damaged("checkpoint version " + std::to_string(footer.version) + "; this server reads version " +
                  std::to_string(kCheckpointVersion));
  if (footer.sum != sum_of_footer(footer)) throw damaged("its footer does not match its sum");
  if (footer.image_bytes != file.size() - sizeof footer) throw damaged("its length is not what its footer says");
  if (footer.generation != generation)
    throw damaged("it is generation " + std::to_string(footer.generation) + " under the name of another");
  const Bytes image = file.first(footer.image_bytes);
  if (footer.image_sum != sum_of_image(image)) throw damaged("its bytes do not match their hash");
  return image;
}

Snapshot read_checkpoint(Bytes file, const std::string& name, std::uint64_t generation) {
  const Bytes image = verified_image(file, name, generation);
  try {
    const hdf5::File opened = open_image(image);
    Snapshot snapshot;
    CheckpointFooter footer;
    std::memcpy(&footer, file.data() + file.size() - sizeof footer, sizeof footer);
    snapshot.store = footer.store;
    if (text_of(opened, "format") != kFormat || number_of(opened, "format_version") != kCheckpointVersion)
      throw Hdf5Error("find the format it was written for");
    snapshot.server_version = text_of(opened, "server_version");
    snapshot.next_index = number_of(opened, "next_index");
    const hdf5::Group sessions = open_group(opened, "sessions");
    const auto names = children_of(sessions);
    snapshot.sessions = closed_in(opened);
    const std::size_t closed = snapshot.sessions.size();
    snapshot.sessions.resize(closed + names.size());
    for (const std::string& child : names) {
      std::uint64_t order = 0;
      SessionImage session = session_of(sessions, child, order);
      if (order >= names.size()) throw Hdf5Error("order the sessions");
      snapshot.sessions[closed + order] = std::move(session);
    }
    const hdf5::Group transfers = open_group(opened, "transfers");
    for (const std::string& child : children_of(transfers)) snapshot.transfers.push_back(transfer_of(transfers, child));
    if (has_child(opened, "pending")) {
      const hdf5::Group pending = open_group(opened, "pending");
      const std::size_t count = children_of(pending).size();
      for (std::size_t i = 0; i < count; ++i) snapshot.pending.push_back(pending_of(pending, i));
    }
    return snapshot;
  } catch (const Hdf5Error& fault) {
    throw DamagedFile(name + ": its hash is right, but " + fault.what());
  } catch (const std::out_of_range&) {
    throw DamagedFile(name + ": its hash is right, but its lists of closed sessions have unequal lengths");
  }
}

namespace {

constexpr const char* kCapsuleFormat = "shearbus failure capsule";

void put_values(hid_t parent, const std::string& name, const std::vector<CapsuleValue>& values) {
  const hdf5::Group group = make_group(parent, name);
  std::string names;
  for (const CapsuleValue& value : values) {
    names += (names.empty() ? "" : " ") + value.name;
    put_numbers(group, value.name, std::vector<double>{value.value}, 1);
  }
  put_text(group, "columns", names);
}

std::vector<CapsuleValue> values_of(hid_t parent, const std::string& name) {
  const hdf5::Group group = open_group(parent, name);
  std::vector<CapsuleValue> values;
  for (const std::string& column : words_of(text_of(group, "columns"))) {
    const auto numbers = numbers_of<double>(group, column);
    if (numbers.size() != 1)
      throw Hdf5Error(std::string("find one number in ").append(name).append("/").append(column));
    values.push_back({column, numbers.front()});
  }
  return values;
}

double double_of(hid_t group, const std::string& name) {
  const auto numbers = numbers_of<double>(group, name);
  if (numbers.size() != 1) throw Hdf5Error("find one number in " + name);
  return numbers.front();
}

}  // namespace

std::vector<std::byte> capsule_bytes(const Capsule& capsule) {
  const hdf5::File file = new_image();
  put_text(file, "format", kCapsuleFormat);
  put_number(file, "format_version", kCapsuleVersion);
  put_text(file, "server_version", capsule.server_version);
  put_text(file, "units_system", "SI");
  put_text(file, "session", hexadecimal(capsule.session));
  put_number(file, "sequence", capsule.sequence);
  put_number(file, "node_id", capsule.node_id);
  put_number(file, "step", capsule.step);
  put_number(file, "attempt", capsule.attempt);
  put_numbers(file, "dt_s", std::vector<double>{capsule.dt_s}, 1);
  put_numbers(file, "time_s", std::vector<double>{capsule.time_s}, 1);
  put_text_dataset(file, "scene_toml", capsule.scene);
  put_states(file, "state", capsule.state);
  put_values(file, "inputs", capsule.inputs);
  put_values(file, "answer", capsule.answer);
  return bytes_of_image(file);
}

Capsule read_capsule(Bytes file, const std::string& name) try {
  const hdf5::File opened = open_image(file);
  if (text_of(opened, "format") != kCapsuleFormat || number_of(opened, "format_version") != kCapsuleVersion)
    throw Hdf5Error("find the format \"" + std::string(kCapsuleFormat) + "\", version " +
                    std::to_string(kCapsuleVersion));
  return {.server_version = text_of(opened, "server_version"),
          .session = key_from(text_of(opened, "session")),
          .sequence = number_of(opened, "sequence"),
          .scene = text_in_dataset(opened, "scene_toml"),
          .node_id = number_of(opened, "node_id"),
          .dt_s = double_of(opened, "dt_s"),
          .time_s = double_of(opened, "time_s"),
          .step = number_of(opened, "step"),
          .attempt = number_of(opened, "attempt"),
          .state = states_of(opened, "state"),
          .inputs = values_of(opened, "inputs"),
          .answer = values_of(opened, "answer")};
} catch (const Hdf5Error& fault) {
  throw DamagedFile(name + ": not a failure capsule that can be read: " + fault.what());
}

}  // namespace shearbus::store
