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

#include "proto/wire/limits.hpp"
#include "proto/wire/messages.hpp"
#include "server/session/session.hpp"
#include "server/shard/shard.hpp"
#include "server/shard/task_pool.hpp"

namespace shearbus::service {

using Frames = std::span<const std::span<const std::byte>>;

// A reply ready to be sent. The payload is not copied: `owner` keeps it alive for as long as a socket needs it.
struct ReplyFrames {
  std::string header;
  bool has_payload = false;
  std::span<const std::byte> payload;
  std::shared_ptr<const void> owner;
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

class Service {
 public:
  Service(ServiceOptions options, shard::TaskPool& pool);
  ~Service();

  // The answer to one request. Never throws. Empty only when the request was run and its answer found no memory: the
  // client will repeat it and be answered then.
  std::optional<ReplyFrames> handle(Frames frames) noexcept;

  // From here on every request is refused with SHUTTING_DOWN.
  void begin_shutdown() { shutting_down_ = true; }

  wire::ServerStatus status() const;

 private:
  // A session and the states it owns. A closed one stays for a while without states: it knows a repeated goodbye, and a
  // late copy of its opening cannot bring it back.
  struct Member;
  using Members = std::map<wire::SessionId, std::unique_ptr<Member>>;
  using ReplyPtr = std::shared_ptr<wire::Reply>;

  ReplyPtr answer(Frames frames, const ReplyPtr& reply);
  ReplyPtr answer_in_session(const wire::Request& request, std::uint64_t hash, std::uint64_t started_ns,
                             const ReplyPtr& reply);
  void hello(const wire::Hello& hello, wire::Reply& reply) const;
  ReplyPtr open_session(const wire::OpenSession& open, const wire::Request& request, std::uint64_t hash,
                        const ReplyPtr& reply);
  void check_epoch(const wire::Request& request) const;
  void check_memory(const physics::Model& model, std::size_t nodes) const;
  void downscale(Member& member, const wire::Downscale& step, const wire::Request& request, std::uint64_t hash,
                 std::uint64_t started_ns, const ReplyPtr& reply);
  void close_session(Member& member, const wire::CloseSession& close, wire::Reply& reply);
  void log(const std::string& line) const;

  static constexpr std::size_t kClosedSessionsKept = 256;

  ServiceOptions options_;
  shard::TaskPool& pool_;
  std::uint64_t started_ns_ = 0;
  bool shutting_down_ = false;
  Members members_;                     // open and closed
  std::deque<wire::SessionId> closed_;  // oldest first
  wire::ServerStatus metrics_;
};

}  // namespace shearbus::service
