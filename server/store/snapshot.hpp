// The contents of a checkpoint: all sessions and offers of a server, as plain values.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "server/shard/states.hpp"
#include "server/store/format.hpp"

namespace shearbus::store {

// How a file holds a field, and what a comparison of two files says of it. Numbers, ids and texts are attributes of a
// group, lists are datasets, states are groups.
struct FieldOf {
  bool maybe = false;              // absent where it is 0 or empty
  bool dataset = false;            // a text that may be longer than an attribute, which holds at most 64 kB
  const char* compared = nullptr;  // null: not compared
};

// States that a client saved under a name.
struct MarkImage {
  std::string name;
  std::uint64_t sequence = 0;  // sequence number of the request that made the mark
  std::uint64_t state_version = 0;
  std::vector<std::uint64_t> node_ids;
  shard::States states;

  // Calls v(name in the file, member, FieldOf) for each field.
  static void fields(auto&& v) {
    v("name", &MarkImage::name, FieldOf{});
    v("sequence", &MarkImage::sequence, FieldOf{});
    v("state_version", &MarkImage::state_version, FieldOf{.compared = "state version"});
    v("node_id", &MarkImage::node_ids, FieldOf{.compared = "nodes, or in another order"});
    v("states", &MarkImage::states, FieldOf{.compared = ""});
  }
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

  static void fields(auto&& v) {  // but the id, which names the group
    v("giver", &TransferImage::giver, FieldOf{});
    v("sequence", &TransferImage::sequence, FieldOf{});
    v("identity", &TransferImage::identity, FieldOf{});
    v("domain", &TransferImage::domain, FieldOf{});
    v("layers_toml", &TransferImage::layers, FieldOf{.dataset = true});
    v("node_id", &TransferImage::node_ids, FieldOf{.compared = "nodes, or in another order"});
    v("states", &TransferImage::states, FieldOf{.compared = ""});
  }
};

// What a server knows of a session in addition to its nodes, states and replies. The service keeps it in this form.
struct SessionFacts {
  SessionKey id{};
  std::string identity;            // identity that owns the session
  SessionKey resume_token{};       // all zero: the session cannot be resumed
  std::string domain;              // empty: the session is in no domain
  std::uint64_t idle_limit_s = 0;  // the session is closed after this time without a request; 0: never
  std::string scene;               // effective scene, as TOML
  std::uint64_t requests = 0;      // totals since the opening
  std::uint64_t node_steps = 0;
  std::uint64_t asleep_node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t claim = 0;     // number of the last granted claim of a client (resume_session); 0: none yet
  std::uint64_t claimant = 0;  // random number of the client to which the last claim was granted
  // Epoch of the client that owns the session, which may be one of an earlier server (0: not known), and epochs of the
  // clients that owned the session before, newest last.
  std::uint64_t owner_epoch = 0;
  std::vector<std::uint64_t> superseded;

  static void fields(auto&& v) {  // but the id, which names the group
    v("identity", &SessionFacts::identity, FieldOf{});
    v("resume_token", &SessionFacts::resume_token, FieldOf{});
    v("domain", &SessionFacts::domain, FieldOf{});
    v("idle_limit_s", &SessionFacts::idle_limit_s, FieldOf{.maybe = true});
    v("scene_toml", &SessionFacts::scene, FieldOf{.dataset = true, .compared = "scenes"});
    v("requests", &SessionFacts::requests, FieldOf{});
    v("node_steps", &SessionFacts::node_steps, FieldOf{});
    v("asleep_node_steps", &SessionFacts::asleep_node_steps, FieldOf{.maybe = true});
    v("solver_ns", &SessionFacts::solver_ns, FieldOf{});
    v("claim", &SessionFacts::claim, FieldOf{.maybe = true});
    v("claimant", &SessionFacts::claimant, FieldOf{.maybe = true});
    v("owner_epoch", &SessionFacts::owner_epoch, FieldOf{.maybe = true});
    v("superseded_epochs", &SessionFacts::superseded, FieldOf{.maybe = true});
  }
};

struct SessionImage : SessionFacts {
  bool open = true;  // false: closed, and kept only to repeat its last reply; then it has no scene and domain either
  std::uint64_t last_sequence = 0;
  std::uint64_t last_hash = 0;           // XXH3-64 of the last request's bytes
  std::vector<std::byte> reply_header;   // header frame of the reply to the last request
  std::vector<std::byte> reply_payload;  // payload of this reply; may be empty

  // The following members are set for open sessions only.
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

  static void fields(auto&& v) {
    SessionFacts::fields(v);
    v("last_sequence", &SessionImage::last_sequence, FieldOf{.compared = "last request"});
    v("last_request_xxh3", &SessionImage::last_hash, FieldOf{});
    v("reply_header", &SessionImage::reply_header, FieldOf{});
    v("reply_payload", &SessionImage::reply_payload, FieldOf{});
    v("request_before_xxh3", &SessionImage::before_hash, FieldOf{.maybe = true});
    v("reply_before_header", &SessionImage::before_header, FieldOf{.maybe = true});
    v("reply_before_payload", &SessionImage::before_payload, FieldOf{.maybe = true});
    v("node_id", &SessionImage::node_ids, FieldOf{.compared = "nodes, or in another order"});
    v("state_version", &SessionImage::state_version, FieldOf{.compared = "state version"});
    v("committed", &SessionImage::committed, FieldOf{.compared = ""});
    v("part_header", &SessionImage::part_header, FieldOf{.maybe = true, .compared = "parts of a step have come"});
    v("part_rows", &SessionImage::part_rows, FieldOf{.maybe = true, .compared = "parts of a step have come"});
    v("trial", &SessionImage::trial, FieldOf{.compared = "trial"});
    v("marks", &SessionImage::marks, FieldOf{.compared = "marks"});
  }
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

  static void fields(auto&& v) {
    v("server_version", &Capsule::server_version, FieldOf{});
    v("session", &Capsule::session, FieldOf{});
    v("sequence", &Capsule::sequence, FieldOf{});
    v("node_id", &Capsule::node_id, FieldOf{});
    v("step", &Capsule::step, FieldOf{});
    v("attempt", &Capsule::attempt, FieldOf{});
    v("dt_s", &Capsule::dt_s, FieldOf{});
    v("time_s", &Capsule::time_s, FieldOf{});
    v("scene_toml", &Capsule::scene, FieldOf{.dataset = true});
    v("state", &Capsule::state, FieldOf{});
    v("inputs", &Capsule::inputs, FieldOf{});
    v("answer", &Capsule::answer, FieldOf{});
  }
};

// A journaled request whose step was being computed when the snapshot was made. The states are those before the step.
struct PendingRequest {
  SessionKey session{};
  std::uint64_t epoch = 0;          // of the server that journaled it
  bool previous_committed = false;  // the trial that the request commits has been committed
  std::vector<std::byte> header_frame;
  std::vector<std::byte> payload_frame;  // empty: the request has none

  static void fields(auto&& v) {
    v("session", &PendingRequest::session, FieldOf{});
    v("epoch", &PendingRequest::epoch, FieldOf{});
    v("previous_committed", &PendingRequest::previous_committed, FieldOf{});
    v("header_frame", &PendingRequest::header_frame, FieldOf{});
    v("payload_frame", &PendingRequest::payload_frame, FieldOf{});
  }
};

struct Snapshot {
  StoreId store{};                     // id of the state directory
  std::uint64_t next_index = 0;        // index of the first journal record whose effect is not yet in the sessions
  std::string server_version;          // version of the server that wrote the checkpoint
  std::vector<SessionImage> sessions;  // first the closed sessions, in the order of closing; then the open ones
  std::vector<TransferImage> transfers;
  std::vector<PendingRequest> pending;  // in the order of the journal
  // Fills in what takes long to copy, which the snapshot only refers to until then: states and payloads. Called once, by
  // whoever reads the snapshot, on any thread. Empty: nothing is missing.
  std::function<void(Snapshot&)> complete;
};

}  // namespace shearbus::store
