// Bytes in, bytes out: the whole server but its socket. One thread at a time. Same requests, same clock, same epoch:
// same bytes.
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

// A reply ready to be sent. The payload is not copied: `owner` keeps it alive for as long as a socket needs it.
struct ReplyFrames {
  std::string header;
  bool has_payload = false;
  std::span<const std::byte> payload;
  std::shared_ptr<const void> owner;
};

// Who a request is from, as the server's door has made sure. A session belongs to the identity that opened it.
struct Caller {
  std::string_view identity;  // "uid 1000", "key ...", "anonymous" or "process"
  bool is_operator = false;   // may act for every identity, and on the server itself
};

struct ServiceOptions {
  std::uint64_t epoch = 1;  // of this incarnation of the server; not 0
  std::string server_version;
  std::uint64_t max_state_bytes = std::uint64_t{8} << 30;  // of all sessions' states together
  std::size_t max_sessions = wire::kMaxSessions;
  std::size_t nodes_per_task = 512;
  std::function<std::uint64_t()> now_ns;                     // a clock that never goes back
  std::function<void(const std::string&)> log;               // a line when a session opens or closes; may be empty
  std::function<void(wire::ServerStatus&)> complete_status;  // with what others than the service count; may be empty
  std::function<void(bool begins)> around_checkpoint;        // one begins, or has ended; may be empty
};

class Service : private store::Recovery {
 public:
  // With a store, requests outlive the server as its durability says; without one, nothing does.
  Service(ServiceOptions options, shard::TaskPool& pool, store::Store* store = nullptr);
  ~Service() override;

  // Once, before the first request: takes up what the store holds. Throws where it cannot be used.
  void recover();

  // The answer to one request. Never throws. Empty where the request was run and its answer found no memory (the client
  // will repeat it and be answered then), and always once failed().
  std::optional<ReplyFrames> handle(Frames frames, const Caller& caller = {}) noexcept;

  // What was promised of a request that was run can no longer be held: nothing is answered any more. The server must
  // end; the next one recovers.
  bool failed() const { return failed_ || (store_ != nullptr && store_->failed()); }

  // Writes the states of all sessions to the store. False where there is none or it could not be done.
  bool checkpoint();

  // Drained, and no session is left: the server was asked to end then.
  bool drained() const { return exit_when_drained_ && metrics_.sessions == 0; }

  // From here on every request is refused with SHUTTING_DOWN.
  void begin_shutdown() { shutting_down_ = true; }

  wire::ServerStatus status() const;

 private:
  // A session and the states it owns. A closed one stays for a while without states: it knows a repeated goodbye, and a
  // late copy of its opening cannot bring it back.
  struct Member;
  struct Arrival;
  // Sessions of one identity that named the same; without a name a session is alone.
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
  void check_memory(std::uint64_t wanted, std::size_t nodes) const;
  ReplyPtr repeat(const Member& member);
  void downscale(Member& member, const wire::Downscale& step, const Arrival& arrival, const ReplyPtr& reply);
  wire::SessionOpened opened(const Member& member) const;
  // At the model's initial temperature.
  std::unique_ptr<shard::Shard> make_shard(physics::Model model, const std::vector<std::uint64_t>& node_ids) const;

  // capsules.cpp: what nodes without an answer leave behind.
  struct FailedStep {
    const wire::Batch& answer;
    std::span<const std::uint8_t> outcomes;
    bool from_trial;  // the states it started from
  };
  void leave_capsules(const Member& member, const wire::Downscale& step, const Arrival& arrival,
                      const shard::Rows& rows, const FailedStep& failed) noexcept;

  // nodes.cpp: the set of a session's nodes, and the marks that keep it.
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

  static constexpr std::size_t kClosedSessionsKept = 256;

  ServiceOptions options_;
  shard::TaskPool& pool_;
  store::Store* store_;
  std::uint64_t epoch_;       // options_.epoch; during recovery that of the server that answered
  std::uint64_t claims_ = 0;  // granted: each brings an epoch of its own, counted on from the server's
  bool replaying_ = false;    // during recovery
  bool kept_ = false;         // the request at hand is in the journal, and not yet run
  bool failed_ = false;
  std::uint64_t started_ns_ = 0;
  bool shutting_down_ = false;
  bool draining_ = false;
  bool exit_when_drained_ = false;
  Members members_;                                             // open and closed
  std::deque<wire::SessionId> closed_;                          // oldest first
  std::map<wire::TransferId, store::TransferImage> transfers_;  // nodes on their way, which no session has
  wire::ServerStatus metrics_;
  Metrics times_;
  struct Current {  // the request at hand
    std::size_t verb = 0;
    std::uint64_t started_ns = 0;
  } current_;
  std::uint64_t last_checkpoint_ns_ = 0;
};

}  // namespace shearbus::service
