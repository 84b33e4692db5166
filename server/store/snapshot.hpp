// The contents of a checkpoint: all sessions and offers of a server, as plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/shard/states.hpp"
#include "server/store/format.hpp"

namespace shearbus::store {

// States that a client saved under a name (wire::Mark).
struct MarkImage {
  std::string name;
  std::uint64_t sequence = 0;  // sequence number of the request that made the mark
  std::uint64_t state_version = 0;
  std::vector<std::uint64_t> node_ids;
  shard::States states;
};

// Nodes that one session has offered and no session has accepted yet.
struct TransferImage {
  SessionKey id{};
  SessionKey giver{};          // session that made the offer
  std::uint64_t sequence = 0;  // sequence number of the request that made the offer
  std::string identity;        // identity that owns the domain
  std::string domain;
  std::string layers;  // TOML text of the layers; the session that accepts must have the same
  std::vector<std::uint64_t> node_ids;
  shard::States states;
};

struct SessionImage {
  SessionKey id{};
  bool open = true;                // false: closed, and kept only to repeat its last reply
  std::string identity;            // identity that owns the session
  SessionKey resume_token{};       // all zero: the session cannot be resumed
  std::string domain;              // empty: the session is in no domain
  std::uint64_t idle_limit_s = 0;  // the session is closed after this time without a request; 0: never
  std::uint64_t last_sequence = 0;
  std::uint64_t last_hash = 0;           // XXH3-64 of the last request's bytes
  std::vector<std::byte> reply_header;   // header frame of the reply to the last request
  std::vector<std::byte> reply_payload;  // payload of this reply; may be empty
  std::uint64_t requests = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t claim = 0;  // number of the last granted claim; 0: none yet
  std::uint64_t claimant = 0;
  std::uint64_t owner_epoch = 0;          // epoch of the client that owns the session; 0: not known
  std::vector<std::uint64_t> superseded;  // epochs of clients that owned it before

  // The following members are set for open sessions only, as are `domain` and `idle_limit_s`.
  std::string scene;  // effective scene, as TOML
  std::vector<std::uint64_t> node_ids;
  std::uint64_t state_version = 0;
  shard::States committed;
  std::optional<shard::States> trial;
  std::vector<std::byte> part_header;    // header frame of the last part of a step of which parts are missing, or empty
  std::vector<std::uint32_t> part_rows;  // rows of the nodes of the parts that have come, ascending
  // The request before the last one, if the last one is a part that follows it: hash of its bytes and its reply, whose
  // header frame is empty otherwise.
  std::uint64_t before_hash = 0;
  std::vector<std::byte> before_header;
  std::vector<std::byte> before_payload;
  std::vector<MarkImage> marks;  // marks of the session, oldest first
};

// One column of a capsule. A capsule records a failed step of one node, with all inputs needed to repeat the step for
// this node alone.
struct CapsuleValue {
  std::string name;  // name with unit: "pressure_pa"
  double value = 0.0;
};
struct Capsule {
  std::string server_version;
  SessionKey session{};
  std::uint64_t sequence = 0;
  std::string scene;  // effective scene, as TOML
  std::uint64_t node_id = 0;
  double dt_s = 0.0;
  double time_s = 0.0;
  std::uint64_t step = 0;
  std::uint64_t attempt = 0;
  shard::States state;  // state of the node before the failed step; has one row
  std::vector<CapsuleValue> inputs;
  std::vector<CapsuleValue> answer;  // reply columns of the failed step
};

// A journaled request whose step was being computed when the snapshot was made. The states are those before the step.
struct PendingRequest {
  SessionKey session{};
  std::uint64_t epoch = 0;          // of the server that journaled it
  bool previous_committed = false;  // the trial that the request commits has been committed
  std::vector<std::byte> header_frame;
  std::vector<std::byte> payload_frame;  // empty: the request has none
};

struct Snapshot {
  StoreId store{};                     // id of the state directory
  std::uint64_t next_index = 0;        // index of the first journal record whose effect is not yet in the sessions
  std::string server_version;          // version of the server that wrote the checkpoint
  std::vector<SessionImage> sessions;  // first the closed sessions, in the order of closing; then the open ones
  std::vector<TransferImage> transfers;
  std::vector<PendingRequest> pending;  // in the order of the journal
};

}  // namespace shearbus::store
