// One DEALER socket with deadlines and retries. It takes a request to the server and brings the reply to that request.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "client/include/shearbus/client.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus {

struct Received {
  std::shared_ptr<void> payload_frame;  // the batch of `reply` points into it
  wire::Reply reply;
  std::chrono::nanoseconds round_trip{0};
};

class Connection {
 public:
  explicit Connection(ClientOptions options);
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection();

  const ClientOptions& options() const { return options_; }
  std::uint64_t next_request_id();  // never 0

  // Sends `request` until its reply is here: the same bytes again, on a fresh socket, after every `retry_after` without
  // one. Throws Error: the reply's status where it is not OK, kUnreachable where the request never left,
  // kUnknownOutcome where it left and nothing came back before the deadline.
  Received call(const wire::Request& request, std::chrono::milliseconds deadline);

  // Sends without waiting for anything, if that can be done now.
  void say(const wire::Request& request) noexcept;

 private:
  using Clock = std::chrono::steady_clock;
  struct CloseSocket {
    void operator()(void* socket) const;
  };
  struct CloseContext {
    void operator()(void* context) const;
  };

  void connect();
  bool wait(short events, Clock::time_point until);
  bool send(const std::string& header, const wire::Batch& batch);
  bool receive(std::uint64_t request_id, Clock::time_point until, Received& received);
  [[noreturn]] void give_up(bool sent, Clock::duration waited) const;

  ClientOptions options_;
  std::unique_ptr<void, CloseContext> own_context_;  // null where the caller shares one
  std::unique_ptr<void, CloseSocket> socket_;  // null after a timeout: a late reply must not be taken for another's
  std::uint64_t last_request_id_ = 0;
};

}  // namespace shearbus
