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

#include "proto/wire/limits.hpp"
#include "proto/wire/messages.hpp"
#include "server/service/metrics.hpp"
#include "server/session/session.hpp"
#include "server/shard/shard.hpp"
#include "server/shard/task_pool.hpp"
#include "server/store/store.hpp"

namespace shearbus::service {

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
};

struct ServiceOptions {
  std::uint64_t epoch = 1;  // random number that identifies this start of the server; not 0
  std::string server_version;
  std::uint64_t max_state_bytes = std::uint64_t{8} << 30;  // limit of the memory of all sessions' states
  std::size_t max_sessions = wire::kMaxSessions;
  std::size_t max_sessions_per_user = wire::kMaxSessions;  // quotas of a user who is no operator
  std::uint64_t max_state_bytes_per_user = std::uint64_t{8} << 30;
  std::size_t nodes_per_task = 512;
  std::function<std::uint64_t()> now_ns;                     // a monotonic clock
  std::function<void(const std::string&)> log;               // writes one line of the log; may be empty
  std::function<void(wire::ServerStatus&)> complete_status;  // adds counters from outside of the service; may be empty
  std::function<void(bool begins)> around_checkpoint;        // called before and after a checkpoint; may be empty
};

class Service : private store::Recovery {
 public:
  // With a store, requests survive the end of the server as far as the durability of the store promises; without a
  // store nothing survives.
  Service(ServiceOptions options, shard::TaskPool& pool, store::Store* store = nullptr);
  ~Service() override;

  // Restores the sessions of the store. Called once, before the first request. Throws if the store cannot be used.
  void recover();

  // Returns the answer to one request. Never throws. The result is empty if the request has run but there was no memory
  // for its answer (the client repeats the request and gets the answer then), and always after failed().
  std::optional<ReplyFrames> handle(Frames frames, const Caller& caller = {}) noexcept;

  // Whether states and journal may differ because of a failure. The service then answers no further request. The server
  // must end; the next server recovers from the journal.
  bool failed() const { return failed_ || (store_ != nullptr && store_->failed()); }

  // Writes the states of all sessions to the store. False without a store, or if writing failed.
  bool checkpoint();

  // Whether an operator has asked the server to end with the last session and no session is open any more.
  bool drained() const { return exit_when_drained_ && metrics_.sessions == 0; }

  // Closes the sessions that have been idle for as long as their clients allowed. Called between requests.
  void close_idle_sessions() noexcept;

  // Refuses every later request with SHUTTING_DOWN.
  void begin_shutdown() { shutting_down_ = true; }

  wire::ServerStatus status() const;

 private:
  // A session and its states. A closed session stays for a while without states, so that a repeated close_session is
  // answered and a late copy of its opening cannot reopen it.
  struct Member;
  struct Arrival;
  // Sessions of one identity with the same domain name; a session without a name is in no domain.
  struct Domain {
    std::string_view identity;
    std::string_view name;
    bool operator==(const Domain&) const = default;
  };
  using Members = std::map<wire::SessionId, std::unique_ptr<Member>>;
  using ReplyPtr = std::shared_ptr<wire::Reply>;

  ReplyPtr answer(Frames frames, const Caller& caller, const ReplyPtr& reply);
  ReplyPtr answer_in_session(const Arrival& arrival, const ReplyPtr& reply);
  void hello(const wire::Hello& hello, const Caller& caller, wire::Reply& reply) const;
  ReplyPtr open_session(const wire::OpenSession& open, const Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr resume(const wire::ResumeSession& resume, const Arrival& arrival, const ReplyPtr& reply);
  void check_identity(const Member& member, const Caller& caller) const;
  void check_operator(const Caller& caller) const;
  void checkpoint_now(wire::Reply& reply);
  void drain(const wire::Drain& drain, const Caller& caller, wire::Reply& reply);
  void inspect(const wire::Inspect& inspect, const wire::Request& request, wire::Reply& reply) const;
  void top_nodes(const Member& member, const wire::Inspect& inspect, wire::Reply& reply) const;
  wire::SessionInfo info_of(const Member& member) const;
  void check_epoch(const wire::Request& request, const Member* member) const;
  void check_may_open(const wire::Request& request) const;
  // Refuses states that the server, or the quota of the user `owner`, has no memory for.
  void check_memory(std::uint64_t wanted, std::size_t nodes, const Caller& caller, std::string_view owner) const;
  ReplyPtr repeat(const Member& member);
  void downscale(Member& member, const wire::Downscale& step, const Arrival& arrival, const ReplyPtr& reply);
  void report_closure(const Member& member, const wire::Downscale& step, const wire::Batch& batch,
                      const shard::Rows& rows, const shard::Closure& closure, wire::Upscale& upscale) const noexcept;
  wire::SessionOpened opened(const Member& member) const;
  // Makes a shard whose nodes have the model's initial temperature.
  std::unique_ptr<shard::Shard> make_shard(physics::Model model, const std::vector<std::uint64_t>& node_ids,
                                           bool check_closure) const;

  // users.cpp: quotas and counters of users.
  struct Usage {
    std::size_t sessions = 0;
    std::uint64_t nodes = 0;
    std::uint64_t state_bytes = 0;
  };
  struct User {  // counters since the start of the server
    std::uint64_t requests = 0;
    std::uint64_t refused = 0;
    std::uint64_t replayed = 0;
    std::uint64_t node_steps = 0;
    std::uint64_t solver_ns = 0;
  };
  Usage usage_of(std::string_view identity) const;
  void check_session_quota(const Caller& caller) const;
  void check_memory_quota(std::uint64_t wanted, std::size_t nodes, const Caller& caller, std::string_view owner) const;
  wire::ServerStatus status_for(const Caller& caller) const;
  User& user(std::string_view identity);

  // capsules.cpp: failure capsules of nodes without an answer.
  struct FailedStep {
    const wire::Batch& answer;
    std::span<const std::uint8_t> outcomes;
    bool from_trial;  // whether the step started from the trial of the step before it
  };
  void leave_capsules(const Member& member, const wire::Downscale& step, const Arrival& arrival,
                      const shard::Rows& rows, const FailedStep& failed) noexcept;

  // nodes.cpp: the set of a session's nodes, and marks.
  static constexpr std::uint64_t kNoneWithdrawn = std::numeric_limits<std::uint64_t>::max();
  void check_owners(const Domain& domain, const Member* self, std::uint64_t withdrawn_after,
                    std::span<const std::uint64_t> node_ids) const;
  void register_nodes(Member& member, const Arrival& arrival, wire::Reply& reply);
  void retire_nodes(Member& member, const Arrival& arrival, wire::Reply& reply);
  void offer_nodes(Member& member, const wire::OfferNodes& offer, const Arrival& arrival, wire::Reply& reply);
  void accept_nodes(Member& member, const wire::AcceptNodes& accept, const Arrival& arrival, wire::Reply& reply);
  void apply(Member& member, shard::Shard::NodeChange&& change, wire::Reply& reply);
  std::vector<wire::TransferId> offers_of(const Member& member) const;  // oldest first
  void forget_transfers_of(const Domain& domain);
  void mark(Member& member, const wire::Mark& mark, const Arrival& arrival, wire::Reply& reply);
  void rollback(Member& member, const wire::Rollback& rollback, const Arrival& arrival, wire::Reply& reply);
  void rollback_to(Member& member, const store::MarkImage& mark, const Arrival& arrival);
  void withdraw_offers(Member& member, std::uint64_t after_sequence);
  void close_session(Member& member, const wire::CloseSession& close, const Arrival& arrival, wire::Reply& reply);

  void keep(const Arrival& arrival, const wire::SessionId& session, const Member* member);
  void settle();
  store::Snapshot snapshot() const;
  void restore(const store::Snapshot& snapshot) override;
  void replay(const store::Record& record, std::uint64_t epoch) override;
  void clear() override;

  void log(const std::string& line) const noexcept;

  static constexpr std::size_t kClosedSessionsKept = 4096;  // of each user; about 2 kB each

  ServiceOptions options_;
  shard::TaskPool& pool_;
  store::Store* store_;
  std::uint64_t epoch_;       // options_.epoch; during recovery the epoch of the server that ran the request first
  std::uint64_t claims_ = 0;  // number of granted claims (resume_session); claim i has the epoch epoch_ + i
  bool replaying_ = false;    // whether requests of the journal are run again, for recovery
  bool kept_ = false;         // the present request is in the journal and has not run
  bool failed_ = false;
  std::uint64_t started_ns_ = 0;
  bool shutting_down_ = false;
  bool draining_ = false;
  bool exit_when_drained_ = false;
  Members members_;  // all open sessions and the last closed ones
  std::map<std::string, std::deque<wire::SessionId>, std::less<>> closed_;  // by identity, oldest first
  std::map<wire::TransferId, store::TransferImage> transfers_;              // offered nodes, which no session owns
  std::map<std::string, User, std::less<>> users_;                          // by identity
  wire::ServerStatus metrics_;
  Metrics times_;
  struct Current {  // the request that is being answered
    std::size_t verb = 0;
    std::uint64_t started_ns = 0;
  } current_;
  std::uint64_t last_checkpoint_ns_ = 0;
};

}  // namespace shearbus::service
