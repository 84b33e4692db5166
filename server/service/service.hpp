// The server without its socket: frames in, frames out. One thread at a time may call it. Equal requests, clocks and
// epochs give equal bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/codec.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/messages.hpp"
#include "server/service/metrics.hpp"
#include "server/session/session.hpp"
#include "server/shard/shard.hpp"
#include "server/shard/task_pool.hpp"
#include "server/store/store.hpp"

namespace shearbus::service {

class SessionPairs;

using Frames = std::span<const std::span<const std::byte>>;

// The frames of a reply. The payload is not copied: `owner` keeps it alive while a socket needs it.
struct ReplyFrames {
  std::string header;
  bool has_payload = false;
  std::span<const std::byte> payload;
  std::shared_ptr<const void> owner;
};

// The authenticated sender of a request. A session belongs to the identity that opened it.
struct Caller {
  std::string_view identity;  // "uid 1000", "key ...", "anonymous" or "process"
  bool is_operator = false;   // may act in any session and on the server itself
  bool is_revoked = false;    // was admitted, and may do nothing any more
  bool in_process = false;    // its messages stay in this process, where payloads may go without their sums
};

// What became of a request.
enum class Turn {
  kAnswered,   // it was answered, or never will be
  kComputing,  // it is worked on, in slices or aside: ask again after work() has returned true, with the same frames,
               // which must stay where they are in memory
  kWaiting,    // it waits for the work of another request: ask again after work() has returned true
};

struct ServiceOptions {
  std::uint64_t epoch = 1;  // random number that identifies this start of the server; not 0
  std::string server_version;
  std::uint64_t max_state_bytes = std::uint64_t{8} << 30;  // limit of the memory of all sessions' states
  std::size_t max_sessions = wire::kMaxSessions;
  std::size_t max_sessions_per_user = wire::kMaxSessions;  // quotas of a user who is no operator
  std::uint64_t max_state_bytes_per_user = std::uint64_t{8} << 30;
  std::size_t nodes_per_task = 512;
  double slice_work = 0.0;       // work of each thread in one slice of a step  [evaluations]; 0: steps are not sliced
  double max_work_budget = 0.0;  // largest work_budget of a scene; 0: any
  std::function<std::uint64_t()> now_ns;                     // a monotonic clock
  std::function<std::uint64_t()> cpu_ns;                     // processor time of the calling thread; may be empty
  std::function<void(const std::string&)> log;               // writes one line of the log; may be empty
  std::function<void(wire::ServerStatus&)> complete_status;  // adds counters from outside of the service; may be empty
  std::function<void()> while_replaying;  // called often during a recovery; may throw store::Interrupted; may be empty
  // Memory whose use takes about a millisecond: what uses so much of it is done aside  [bytes].
  std::uint64_t aside_from = std::uint64_t{2} << 20;
  std::function<void()> wake;  // called on other threads when computing() has become true; empty: every request that is
                               // no step is answered at once, however long that takes
  std::function<void(bool begins)> around_checkpoint;  // called before (true) and after a checkpoint; may be empty
  std::function<void(Frames request, const ReplyFrames& reply)> exchanged;  // called with every answer; may be empty
};

class Service : private store::Recovery {
 public:
  // With a store, requests survive the end of the server as far as the durability of the store promises; without a
  // store nothing survives.
  Service(ServiceOptions options, shard::TaskPool& pool, store::Store* store = nullptr);
  ~Service() override;

  // Restores the sessions of the store. Called once, before the first request. Throws if the store cannot be used, and
  // store::Interrupted if ServiceOptions::while_replaying does.
  void recover();
  // The answer to any request while recover() runs: RECOVERING, with what has been done.
  std::optional<ReplyFrames> refuse_while_recovering(Frames frames) const noexcept;

  // Returns the answer to one request. Never throws. The result is empty if the request has run but there was no memory
  // for its answer (the client repeats the request and gets the answer then), and always once failed() is true.
  // With `turn` a long step is computed in slices, and the long parts of other requests on a thread aside, while other
  // requests are answered; without it the answer comes at once, and no step may be waiting for work().
  std::optional<ReplyFrames> handle(Frames frames, const Caller& caller = {}, Turn* turn = nullptr) noexcept;

  // Computes one slice of a waiting step, of each in turn, and goes on with the requests whose work aside is done.
  // Returns true if a request is complete, so that requests which wait can be asked again.
  bool work() noexcept;
  bool computing() const;                                              // whether requests wait for work()
  bool busy() const { return !computing_.empty() || !long_.empty(); }  // or have work aside
  // Ends the requests that have work aside. They must not be asked again.
  void give_up() noexcept;

  // Continues a session under another scene, with its states. For programs that replay a part of a session with other
  // laws. Throws Error for a scene at fault, std::invalid_argument for a scene whose layers have other states; the
  // service must then not be used any more.
  void change_scene(const wire::SessionId& session, const std::string& scene, const std::string& scene_file);

  // True if states and journal may differ because of a failure. The service then answers no further request. The server
  // must end; the next server recovers from the journal.
  bool failed() const { return failed_ || (store_ != nullptr && store_->failed()); }

  // Writes the states of all sessions to the store. False without a store, or if writing failed.
  bool checkpoint();
  // The same while requests are answered: begin_checkpoint() copies the states, another thread writes them, and
  // end_checkpoint(), called between requests, completes a checkpoint that is written, or with `wait` waits for it.
  void begin_checkpoint() { begin_checkpoint(true); }
  bool end_checkpoint(bool wait) noexcept;  // whether a checkpoint was completed
  bool checkpointing() const { return job_ != nullptr; }

  // True if an operator has asked the server to end with the last session, and no session is open any more or the time
  // that the operator gave the sessions is over.
  bool drained() const {
    return exit_when_drained_ && (metrics_.sessions == 0 || options_.now_ns() >= drain_until_ns_);
  }

  // Closes the sessions that have been idle for as long as their clients allowed. Called between requests.
  void close_idle_sessions() noexcept;

  // Journals the hash of the last reply of each session that has been quiet for a second, so that a recovery can
  // compare it, as the next request of the session would. Called between requests.
  void prove_last_replies() noexcept;

  // Refuses every later request with SHUTTING_DOWN.
  void begin_shutdown() { shutting_down_ = true; }

  wire::ServerStatus status() const;

 private:
  // A session and its states. A closed session stays for a while without states: the server then still answers a
  // repeated close_session, and a late copy of the request that opened the session cannot open it again.
  struct Member;
  struct Arrival;
  struct RunningStep;
  struct LongRequest;
  struct Verb;   // verb.hpp
  struct Verbs;  // verbs.cpp: one row for each verb
  enum class Trial;
  // Sessions of one identity with the same domain name; a session without a name is in no domain.
  struct Domain {
    std::string_view identity;
    std::string_view name;
    bool operator==(const Domain&) const = default;
  };
  using Members = std::map<wire::SessionId, std::unique_ptr<Member>>;
  using ReplyPtr = std::shared_ptr<wire::Reply>;
  using MarkPtr = std::shared_ptr<const store::MarkImage>;  // a checkpoint may read what the session has dropped
  using TransferPtr = std::shared_ptr<const store::TransferImage>;

  ReplyPtr answer(Frames frames, const Caller& caller, const ReplyPtr& reply);
  ReplyPtr blank_reply();
  void recycle(ReplyPtr reply) noexcept;
  void recycle(std::unique_ptr<RunningStep> step) noexcept;
  static const Verb& verb_of(const wire::Request& request);
  ReplyPtr answer_in_turn(Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr answer_by_verb(Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr answer_in_session(const Verb& verb, Arrival& arrival, const ReplyPtr& reply);
  bool begin_change(const Verb& verb, Member& member);
  void end_change(Member& member, const Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr hello(const wire::Hello& hello, Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr tell_status(const wire::ServerStatusQuery& asked, Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr open_session(const wire::OpenSession& open, Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr resume(const wire::ResumeSession& resume, Arrival& arrival, const ReplyPtr& reply);
  Member& open_member(const wire::SessionId& id) const;  // throws UNKNOWN_SESSION, which says what has become of it
  void check_identity(const Member& member, const Caller& caller) const;
  void check_operator(const Caller& caller) const;
  ReplyPtr checkpoint_now(const wire::Checkpoint& asked, Arrival& arrival, const ReplyPtr& reply);
  bool checkpoint_in_turn();
  void begin_checkpoint(bool aside);
  ReplyPtr drain(const wire::Drain& drain, Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr inspect(const wire::Inspect& inspect, Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr read_profiles(const wire::ReadProfiles& asked, Arrival& arrival, const ReplyPtr& reply);
  void top_nodes(const Member& member, const wire::Inspect& inspect, wire::Reply& reply) const;
  wire::SessionInfo info_of(const Member& member) const;
  void check_epoch(const wire::Request& request, const Member* member) const;
  void check_may_open(const wire::Request& request) const;
  void check_work_budget(const physics::ModelOptions& options) const;
  ReplyPtr repeat(ReplyPtr kept);
  // long_requests.cpp: requests that are no steps and take long. Such a request is run again from its beginning, as a
  // task on a thread of its own. There it has its turn on this thread for all that concerns the service, and gives it up
  // while it does what is long.
  ReplyPtr begin_long(Arrival& arrival, const ReplyPtr& reply);
  void give_turn(LongRequest& request);
  ReplyPtr end_long(LongRequest& request);
  LongRequest* asked_again(Frames frames) const;
  bool resume_long() noexcept;
  void finish_changes() noexcept;
  bool changing() const;
  // Does what takes a time in proportion to `bytes`, the memory it reads or writes, and needs nothing of the service that
  // another request may change. Nothing may be changed before the first such part of a request.
  void aside(std::uint64_t bytes, const std::function<void()>& act);
  // The same for what changes the states of a session and must not fail, after the request is in the journal.
  void change_aside(Member& member, std::uint64_t bytes, const std::function<void()>& act);
  bool wait_while(bool busy, const char* fault);
  bool must_wait_for_domain(std::string_view identity, std::string_view domain);
  bool must_wait_for_changes();
  bool being_opened(const wire::SessionId& session);
  void hold(Member& member);

  // steps.cpp: a step, from its checks to its answer.
  ReplyPtr downscale(Member& member, Arrival& arrival, const ReplyPtr& reply);
  bool make_operators(Member& member, const Arrival& arrival);
  std::unique_ptr<RunningStep> begin_step(Member& member, Arrival& arrival, const ReplyPtr& reply);
  bool slice(Member& member);
  void end_step(Member& member, RunningStep& running, const Arrival& arrival);
  bool must_wait(const Member& member);
  bool follows_running(const Member& member, const Arrival& arrival) const;
  void wait_for_work(Member& member, Frames frames);
  Member* computed_for(Frames frames) const;
  ReplyPtr end_step(Member& member, const Arrival& arrival);
  void report(const shard::Shard& shard, const RunningStep& running, const shard::StepCount& count) const noexcept;
  wire::SessionOpened opened(const Member& member) const;
  std::unique_ptr<shard::Shard> make_shard(shard::PairTable pairs, bool check_closure, bool sum_energy) const;
  // A shard with the nodes of saved states, at the temperature of the start. Throws std::invalid_argument for states of
  // another kind of session.
  std::unique_ptr<shard::Shard> restored_shard(const SessionPairs& pairs, shard::PairTable table,
                                               const std::vector<std::uint64_t>& node_ids,
                                               const shard::States& states) const;
  // What a request says of new nodes.
  struct NewNodes {
    std::optional<shard::PairsOfNodes> pairs;  // of a session of several pairs
    std::vector<double> temperatures;          // [K]
    const shard::PairsOfNodes* of() const { return pairs ? &*pairs : nullptr; }
  };
  static NewNodes new_nodes(const wire::Batch& batch, std::span<const std::string> named, const SessionPairs& pairs,
                            const shard::PairTable& known);

  // Defined in users.cpp: quotas and counters of users.
  struct User {
    wire::ServerStatus counted;  // since the start of the server: requests, node_steps, ...
    std::uint64_t turn_ns = 0;   // time of the solver, from which the order of the users' slices follows
  };
  wire::ServerStatus usage_of(std::string_view identity) const;
  wire::ServerStatus with_server(wire::ServerStatus status) const;
  void check_session_quota(const Caller& caller) const;
  void check_memory(std::uint64_t wanted, std::size_t nodes, const Caller& caller, std::string_view owner) const;
  wire::ServerStatus status_for(const Caller& caller) const;
  User& user(std::string_view identity);

  // Defined in capsules.cpp: writes failure capsules of the nodes for which a step found no answer.
  // from_trial: the step started from a waiting trial, which its request commits first.
  void leave_capsules(const Member& member, const RunningStep& running, bool from_trial) noexcept;

  // Defined in nodes.cpp: the functions that change which nodes a session has, and those of marks.
  static constexpr std::uint64_t kNoneWithdrawn = std::numeric_limits<std::uint64_t>::max();
  void check_owners(const Domain& domain, const Member* self, std::uint64_t withdrawn_after,
                    std::span<const std::uint64_t> node_ids);
  void register_nodes(Member& member, const wire::RegisterNodes& named, const Arrival& arrival, wire::Reply& reply);
  void retire_nodes(Member& member, const wire::RetireNodes& asked, const Arrival& arrival, wire::Reply& reply);
  void offer_nodes(Member& member, const wire::OfferNodes& offer, const Arrival& arrival, wire::Reply& reply);
  void accept_nodes(Member& member, const wire::AcceptNodes& accept, const Arrival& arrival, wire::Reply& reply);
  void apply(Member& member, shard::Shard::NodeChange&& change, std::uint64_t bytes, wire::Reply& reply);
  std::vector<wire::TransferId> offers_of(const Member& member) const;  // waiting offers of the session, oldest first
  void forget_transfers_of(const Domain& domain);
  void commit(Member& member, const wire::Commit& asked, const Arrival& arrival, wire::Reply& reply);
  void mark(Member& member, const wire::Mark& mark, const Arrival& arrival, wire::Reply& reply);
  void rollback(Member& member, const wire::Rollback& rollback, const Arrival& arrival, wire::Reply& reply);
  void rollback_to(Member& member, const store::MarkImage& mark, const Arrival& arrival);
  void withdraw_offers(Member& member, std::uint64_t after_sequence);
  void close_session(Member& member, const wire::CloseSession& close, const Arrival& arrival, wire::Reply& reply);

  void journal(const Arrival& arrival, const wire::SessionId& session, const Member* member,
               std::optional<std::uint64_t> sequence = {});
  void tell_of_journal(const std::exception& fault) noexcept;
  void journal_takes_again() noexcept;
  void grant(Member& member, const wire::ResumeSession& resume, const Arrival& arrival);
  void settle();
  store::Snapshot snapshot();
  void restore(const store::Snapshot& snapshot) override;
  void run_again(std::span<const std::byte> header, std::span<const std::byte> payload, std::string_view identity,
                 std::uint64_t epoch);
  void replay(const store::Record& record, std::uint64_t epoch) override;
  void clear() override;

  void log(const std::string& line) const noexcept;

  static constexpr std::size_t kClosedSessionsKept = 4096;  // of each user; about 6 kB each

  ServiceOptions options_;
  shard::TaskPool& pool_;
  store::Store* store_;
  std::uint64_t epoch_;       // options_.epoch; during recovery the epoch of the server that ran the request first
  std::uint64_t claims_ = 0;  // number of granted claims (resume_session); claim i has the epoch epoch_ + i
  std::uint64_t granted_epoch_ = 0;                 // during a recovery: epoch of the claim that is replayed
  bool replaying_ = false;                          // true while a recovery runs the requests of the journal again
  bool journaled_now_ = false;                      // true while the present request is in the journal and has not run
  bool may_wait_ = false;                           // true if the present request may be answered later
  Turn turn_ = Turn::kAnswered;                     // turn of the present request
  std::deque<Member*> computing_;                   // sessions whose step waits for work(), the next one first
  std::vector<Member*> computed_;                   // sessions whose step is complete and not answered yet
  std::vector<Member*> journaled_;                  // sessions whose request is in the journal, in its order
  std::vector<std::unique_ptr<LongRequest>> long_;  // requests with work aside, and those complete but not answered yet
  LongRequest* turn_of_ = nullptr;                  // the one of them that has its turn
  bool may_step_aside_ = false;                     // whether the present request may become one of them
  // Memory of an earlier step and of its reply, for the next one: a step of a size that the server has answered before
  // allocates next to nothing.
  std::unique_ptr<RunningStep> used_step_;
  wire::Batch used_batch_;
  ReplyPtr used_reply_;
  bool failed_ = false;
  std::string journal_fault_;  // why the journal takes nothing, as the log has told it
  std::uint64_t started_ns_ = 0;
  bool shutting_down_ = false;
  bool draining_ = false;
  bool exit_when_drained_ = false;
  std::uint64_t drain_until_ns_ = std::numeric_limits<std::uint64_t>::max();
  Members members_;  // all open sessions and the last closed ones
  std::map<std::string, std::deque<wire::SessionId>, std::less<>> closed_;  // by identity, oldest first
  std::map<wire::TransferId, TransferPtr> transfers_;                       // offered nodes, which no session owns
  std::map<std::string, User, std::less<>> users_;                          // by identity
  wire::ServerStatus metrics_;
  Metrics times_;
  struct Current {  // the request that is being answered
    std::size_t verb = 0;
    std::uint64_t started_ns = 0;
    wire::PayloadSum sum{};  // whether the request has the sum of its payload, hence the answer
  } current_;
  std::uint64_t last_checkpoint_ns_ = 0;
  bool previous_committed_ = false;  // during a recovery: the trial that the request commits is committed already
  std::shared_ptr<store::Store::CheckpointJob> job_;  // the checkpoint being written by aside_
  std::uint64_t job_started_ns_ = 0;
  shard::Aside aside_;
};

}  // namespace shearbus::service
