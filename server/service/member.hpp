// A session and its states. Included only by the source files of the service.
#pragma once

#include <array>
#include <exception>
#include <memory>
#include <mutex>
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
  wire::PayloadSum sum{};  // whether the request has the sum of its payload
};

// The frames of a journaled request that is not answered yet, for a checkpoint that is written on another thread. They
// are copied there, or at the latest before the request is answered, when their memory may go.
class PendingFrames {
 public:
  using Frames = std::array<std::span<const std::byte>, 2>;
  explicit PendingFrames(const Frames& frames) : frames_(frames) {}

  void copy() noexcept;
  // The copies. Throws std::bad_alloc if there was no memory for them.
  std::array<std::vector<std::byte>, 2> take();

 private:
  std::mutex copying_;
  Frames frames_;
  std::array<std::vector<std::byte>, 2> copies_;
  bool copied_ = false;
  bool no_memory_ = false;
};

// A step being computed. Its columns point into the batches of the request and of the reply.
struct Service::RunningStep {
  wire::Request request;
  std::uint64_t hash = 0;                            // hash of the request's frames
  std::array<std::span<const std::byte>, 2> frames;  // while the step waits for work()
  std::shared_ptr<PendingFrames> pending;            // the same for a checkpoint that is being written; null: none is
  wire::PayloadSum sum{};                            // whether the request has the sum of its payload
  std::uint64_t started_ns = 0;
  ReplyPtr reply;
  shard::Rows rows;
  std::shared_ptr<const shard::Operators> operators;
  shard::StepColumns columns;
  std::vector<std::uint8_t> unasked;  // the outcomes, if the reply has no column for them
  std::shared_ptr<shard::Shard::StepRun> run;
  std::uint64_t solver_ns = 0;
  std::uint64_t ended_ns = 0;  // of the last slice
  bool extends_trial = false;  // parts 2, 3, ...: add rows to the trial that part 1 began
  std::optional<Parts> parts;  // part 1 only: the parts received so far, until the step is complete
  bool journaled = false;      // the request is in the journal
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
  bool journaled = false;  // while it is aside: the state of the request that is being answered
  Current current;
  std::optional<Longest> turn;  // measures its turn
  std::unique_ptr<shard::SideTask> task;
};

// Only the identity that opened a session, and operators, may use it.
struct Service::Member : store::SessionFacts {
  std::uint64_t epoch = 0;  // epoch that requests must carry since the last claim; 0: no claim yet
  session::Session conversation;
  SessionPairs pairs;
  std::unique_ptr<shard::Shard> shard;   // null after the session has been closed
  std::unique_ptr<RunningStep> running;  // null if no step is being computed
  LongRequest* long_request = nullptr;   // null if no request of the session has work aside
  double operators_made_for = 0.0;  // step length whose operators were made aside  [s]; 0: none since the nodes changed
  bool changing = false;            // whether a thread aside changes the states
  std::string scene_name;
  std::uint64_t opened_ns = 0;  // time of the opening, or of the recovery, by the service's clock
  std::uint64_t last_request_ns = 0;
  std::uint64_t proven_sequence = 0;  // last request whose reply's hash is in the journal, or in a checkpoint
  std::string closed_because;         // why the session was closed; empty: no reason given
  std::optional<Parts> parts;         // a step of which parts are missing
  std::vector<MarkPtr> marks;         // marks of the session, oldest first

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
constexpr std::uint64_t kBytesPerId = 64;  // to sort or compare an id
std::uint64_t bytes_of_nodes(const wire::Batch& batch);
// The lists that a shard has of its nodes, made anew when they change.
std::uint64_t bytes_of_lists(std::size_t nodes);
std::uint64_t bytes_of_models(std::size_t nodes, bool several);

// Memory in bytes of the states that a mark or a transfer stores, including the ids of their nodes.
std::uint64_t kept_bytes(const shard::States& states);
std::uint64_t kept_bytes(const shard::Shard& shard, std::size_t nodes);

// The first digits of a session's id, for logs: the whole id is a secret of its client.
std::string short_name(const wire::SessionId& id);

// A text of a client, as one printable line of a log.
std::string printable(const std::string& text);

}  // namespace shearbus::service
