// One DEALER socket with deadlines and retries. It takes a request to the server and brings the reply to that request.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "client/include/shearbus/client.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus {

struct Received {
  std::shared_ptr<void> payload_frame;  // the batch of `reply` points into it
  wire::Reply reply;
  std::chrono::nanoseconds round_trip{0};
};

// What a session needs of the way to its server. The one there is has a socket; tests have others.
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Connection(ClientOptions options) : options_(std::move(options)) {}
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  virtual ~Connection() = default;

  // Sends `request` until its reply is here: the same bytes again, on a fresh socket, after every `retry_after` without
  // one. Throws Error: the reply's status where it is not OK, kUnreachable where the request never left, kAuth as soon
  // as the server refuses the connection, kUnknownOutcome where it left and nothing came back before the deadline.
  virtual Received call(const wire::Request& request, std::chrono::milliseconds deadline) = 0;

  // Sends `request` now, if that can be done without waiting; the call() of the same request that must follow then only
  // waits for its reply.
  virtual void post(const wire::Request& /*request*/) {}

  // Sends without waiting for anything, if that can be done now.
  virtual void say(const wire::Request& request) noexcept = 0;

  virtual Clock::time_point now() const { return Clock::now(); }
  virtual void pause(std::chrono::milliseconds time);

  // Of a call that takes several exchanges: what is left of its deadline.
  std::chrono::milliseconds left_since(Clock::time_point started) const;

  const ClientOptions& options() const { return options_; }
  std::uint64_t next_request_id();  // never 0
  std::uint64_t claimant() {
    return claimant_ != 0 ? claimant_ : claimant_ = next_request_id();
  }  // random, of this client

  // An opening that got no session: nobody knows its outcome, or it was refused, and a late copy may still succeed
  // (when the disk has room again). The same one again must have the same bytes, so that it is one session that holds
  // the nodes.
  std::optional<wire::Request> opening_in_doubt;

  bool durable() const { return durable_; }  // the server's sessions outlive it, says its welcome
  void set_durable(bool durable) { durable_ = durable; }

 private:
  ClientOptions options_;
  std::uint64_t last_request_id_ = 0;  // 0: none drawn yet
  std::uint64_t claimant_ = 0;
  bool durable_ = false;
};

class SocketConnection final : public Connection {
 public:
  explicit SocketConnection(ClientOptions options);
  ~SocketConnection() override;

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override;
  void post(const wire::Request& request) override;
  void say(const wire::Request& request) noexcept override;

 private:
  struct Posted {
    std::uint64_t request_id;
    Clock::time_point at;
  };
  struct CloseSocket {
    void operator()(void* socket) const;
  };
  struct CloseContext {
    void operator()(void* context) const;
  };

  void connect();
  void watch_handshakes();
  std::string own_public_key() const;
  bool wait(short events, Clock::time_point until);
  bool send(const std::string& header, const wire::Batch& batch);
  void read_handshakes();
  bool receive(std::uint64_t request_id, Clock::time_point until, Received& received);
  void handshake_failed(int event, std::uint32_t detail);
  [[noreturn]] void refused(bool sent) const;
  [[noreturn]] void give_up(bool sent, Clock::duration waited) const;

  std::unique_ptr<void, CloseContext> own_context_;  // null where the caller shares one
  std::optional<Posted> posted_;
  std::unique_ptr<void, CloseSocket> monitor_;  // libzmq's word on the handshakes of socket_
  std::unique_ptr<void, CloseSocket> socket_;   // null after a timeout: a late reply must not be taken for another's
  wire::Status refusal_;                        // the server has refused the connection; OK: not so far
  int silent_failures_ = 0;                     // handshakes in a row that were broken off without a reason
};

}  // namespace shearbus
