// Bytes in, bytes out: the whole server but its socket. One thread at a time. Same requests, same clock, same epoch:
// same bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "proto/wire/limits.hpp"
#include "proto/wire/messages.hpp"
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
  std::function<std::uint64_t()> now_ns;        // a clock that never goes back
  std::function<void(const std::string&)> log;  // a line when a session opens or closes; may be empty
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

  // From here on every request is refused with SHUTTING_DOWN.
  void begin_shutdown() { shutting_down_ = true; }

  wire::ServerStatus status() const;

 private:
  // A session and the states it owns. A closed one stays for a while without states: it knows a repeated goodbye, and a
  // late copy of its opening cannot bring it back.
  struct Member;
  struct Arrival;
  using Members = std::map<wire::SessionId, std::unique_ptr<Member>>;
  using ReplyPtr = std::shared_ptr<wire::Reply>;

  ReplyPtr answer(Frames frames, const Caller& caller, const ReplyPtr& reply);
  ReplyPtr answer_in_session(const Arrival& arrival, const ReplyPtr& reply);
  void hello(const wire::Hello& hello, const Caller& caller, wire::Reply& reply) const;
  ReplyPtr open_session(const wire::OpenSession& open, const Arrival& arrival, const ReplyPtr& reply);
  ReplyPtr resume(const wire::ResumeSession& resume, const Arrival& arrival, const ReplyPtr& reply);
  void check_identity(const Member& member, const Caller& caller) const;
  void check_epoch(const wire::Request& request, const Member* member) const;
  void check_memory(std::uint64_t wanted, std::size_t nodes) const;
  ReplyPtr repeat(const Member& member);
  void downscale(Member& member, const wire::Downscale& step, const Arrival& arrival, const ReplyPtr& reply);
  void mark(Member& member, const wire::Mark& mark, const Arrival& arrival, wire::Reply& reply);
  void rollback(Member& member, const wire::Rollback& rollback, const Arrival& arrival, wire::Reply& reply);
  void close_session(Member& member, const wire::CloseSession& close, const Arrival& arrival, wire::Reply& reply);

  void keep(const Arrival& arrival, const wire::SessionId& session, const Member* member);
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
  Members members_;                     // open and closed
  std::deque<wire::SessionId> closed_;  // oldest first
  wire::ServerStatus metrics_;
};

}  // namespace shearbus::service
