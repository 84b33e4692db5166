// A session and its states. Included only by the source files of the service.
#pragma once

#include <array>
#include <exception>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "server/service/pairs.hpp"
#include "server/service/parts.hpp"
#include "server/service/service.hpp"
#include "server/shard/side_task.hpp"

namespace shearbus::service {

// A request being answered.
struct Service::Arrival {
  Frames frames;
  Caller caller;
  wire::Request request;
  std::uint64_t hash = 0;  // hash of the frames
  std::uint64_t started_ns = 0;
};

// A step being computed. Its columns point into the batches of the request and of the reply.
struct Service::RunningStep {
  wire::Request request;
  std::uint64_t hash = 0;                            // hash of the request's frames
  std::array<std::span<const std::byte>, 2> frames;  // while the step waits for work()
  std::uint64_t started_ns = 0;
  ReplyPtr reply;
  shard::Rows rows;
  std::shared_ptr<const shard::Operators> operators;
  shard::StepColumns columns;
  std::vector<std::uint8_t> unasked;  // the outcomes, if the reply has no column for them
  std::shared_ptr<shard::Shard::StepRun> run;
  std::uint64_t solver_ns = 0;
  std::uint64_t ended_ns = 0;  // of the last slice
  bool further = false;        // the step adds its rows to the trial of the parts before
  std::optional<Parts> parts;  // of part 1: those that have come when it has run, if others are missing
  bool kept = false;           // the request is in the journal
  bool done = false;

  const wire::Downscale& step() const { return std::get<wire::Downscale>(request.body); }
  std::span<const std::uint8_t> outcomes() const;
  void clear() noexcept;  // frees everything but memory that a later step may use
};

// A request with work aside.
struct Service::LongRequest {
  Arrival arrival;
  std::array<std::span<const std::byte>, 2> frames;  // what arrival.frames is
  ReplyPtr reply;
  std::string owner;         // user whose sessions it concerns
  std::string domain;        // domain whose nodes it may change
  wire::SessionId opens{};   // session that it opens
  Member* member = nullptr;  // session of the request; null for one that is being opened
  ReplyPtr answer;           // when it has ended: the answer, or the fault
  std::exception_ptr fault;
  bool kept = false;  // while it is aside: the state of the request that is being answered
  Current current;
  std::optional<Longest> turn;  // measures its turn
  std::unique_ptr<shard::SideTask> task;
};

struct Service::Member {
  wire::SessionId id{};
  std::string identity;  // identity that opened the session; only this identity and operators may use the session
  wire::ResumeToken resume_token{};  // all zero: the session cannot be resumed
  std::uint64_t claim = 0;           // number of the last granted claim of a client (resume_session); 0: none yet
  std::uint64_t claimant = 0;        // random number of the client to which the last claim was granted
  std::uint64_t epoch = 0;           // epoch that requests must carry since the last claim; 0: no claim yet
  // Epoch of the client that owns the session, which may be one of an earlier server, and epochs of the clients that
  // owned the session before, newest last.
  std::uint64_t owner_epoch = 0;
  std::vector<std::uint64_t> superseded;
  session::Session conversation;
  SessionPairs pairs;
  std::unique_ptr<shard::Shard> shard;   // null after the session has been closed
  std::unique_ptr<RunningStep> running;  // null if no step is being computed
  LongRequest* long_request = nullptr;   // null if no request of the session has work aside
  double operators_made_for = 0.0;  // step length whose operators were made aside  [s]; 0: none since the nodes changed
  bool changing = false;            // whether a thread aside changes the states
  std::string domain;               // name of the session's domain; empty: none
  std::string scene_name;
  std::string scene;            // scene with all defaults filled in, as TOML
  std::uint64_t opened_ns = 0;  // time of the opening, or of the recovery, by the service's clock
  std::uint64_t last_request_ns = 0;
  std::uint64_t proven_sequence = 0;    // last request whose reply's hash is in the journal, or in a checkpoint
  std::uint64_t idle_limit_s = 0;       // the session is closed after this time without a request; 0: never
  std::string closed_because;           // why the session was closed; empty: no reason given
  std::optional<Parts> parts;           // a step of which parts are missing
  std::vector<store::MarkImage> marks;  // marks of the session, oldest first
  wire::SessionClosed totals;

  // Whether a trial stands that could be committed. A step of which parts are missing is none.
  bool trial_stands() const { return shard->has_trial() && !parts; }
  std::uint64_t held_bytes() const;  // memory of states and marks  [bytes]
  std::uint64_t held_before = 0;     // held_bytes() before a thread aside has begun to change the states
  std::uint64_t nodes_before = 0;    // and the number of nodes
  Domain domain_it_is_in() const { return {identity, domain}; }
};

// Turns a reply into the answer to a repeated request: without times, so that it has the same bytes whether or not the
// server was restarted in between.
void make_repeat(wire::Reply& reply);

// A batch whose only column is the ids of the nodes.
wire::Batch node_column(std::span<const std::uint64_t> node_ids);

// What it takes to check the node ids of a request, and to make models for nodes that may each have a pair of their own,
// as memory that takes as long to write  [bytes].
std::uint64_t bytes_of_nodes(const wire::Batch& batch);
std::uint64_t bytes_of_models(std::size_t nodes, bool several);

// Memory in bytes of the states that a mark or a transfer stores, including the ids of their nodes.
std::uint64_t kept_bytes(const shard::States& states);
std::uint64_t kept_bytes(const shard::Shard& shard, std::size_t nodes);

// The first digits of a session's id, for logs: the whole id is a secret of its client.
std::string short_name(const wire::SessionId& id);

// A text of a client, as one printable line of a log.
std::string printable(const std::string& text);

}  // namespace shearbus::service
