// Everything a server holds, as values: what a checkpoint keeps.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/shard/states.hpp"
#include "server/store/format.hpp"

namespace shearbus::store {

// States kept under a name.
struct MarkImage {
  std::string name;
  std::uint64_t sequence = 0;  // of the request that made it
  std::uint64_t state_version = 0;
  std::vector<std::uint64_t> node_ids;
  shard::States states;
};

// Nodes on their way from one session to another.
struct TransferImage {
  SessionKey id{};
  SessionKey giver{};
  std::uint64_t sequence = 0;  // of the giver's request
  std::string identity;        // whose domain it is
  std::string domain;
  std::string layers;  // what a session's scene must be to take them
  std::vector<std::uint64_t> node_ids;
  shard::States states;
};

struct SessionImage {
  SessionKey id{};
  bool open = true;           // a closed session keeps its conversation only
  std::string identity;       // who the session belongs to
  SessionKey resume_token{};  // all zero: none
  std::string domain;         // empty: none
  std::uint64_t last_sequence = 0;
  std::uint64_t last_hash = 0;           // of the last request's bytes
  std::vector<std::byte> reply_header;   // the kept reply's frames
  std::vector<std::byte> reply_payload;  // empty: none
  std::uint64_t requests = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;

  // Of an open session.
  std::string scene;  // effective, as TOML
  std::vector<std::uint64_t> node_ids;
  std::uint64_t state_version = 0;
  shard::States committed;
  std::optional<shard::States> trial;
  std::vector<MarkImage> marks;  // oldest first
};

// A node's step that failed, with all that is needed to run it again alone.
struct CapsuleValue {
  std::string name;  // with its unit: "pressure_pa"
  double value = 0.0;
};
struct Capsule {
  std::string server_version;
  SessionKey session{};
  std::uint64_t sequence = 0;
  std::string scene;  // effective, as TOML
  std::uint64_t node_id = 0;
  double dt_s = 0.0;
  double time_s = 0.0;
  std::uint64_t step = 0;
  std::uint64_t attempt = 0;
  shard::States state;  // that it started from, one row
  std::vector<CapsuleValue> inputs;
  std::vector<CapsuleValue> answer;  // what the host was, or would have been, told
};

struct Snapshot {
  std::uint64_t next_index = 0;        // of the journal: the first record these states have not seen
  std::string server_version;          // that wrote it
  std::vector<SessionImage> sessions;  // closed ones in the order of their closing
  std::vector<TransferImage> transfers;
};

}  // namespace shearbus::store
