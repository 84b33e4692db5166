// The only server socket: a ROUTER that takes messages of bytes to a handler and the answers back. It knows nothing of
// what the bytes mean. It belongs to one thread, which may be another than the one that made it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>
#include <zmq.hpp>

namespace shearbus::transport {

// A frame to send. Small ones are copied; of large ones `owner` keeps the bytes alive until the network has them.
struct OutFrame {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
};

using Frames = std::span<const std::span<const std::byte>>;
using Handler = std::function<std::vector<OutFrame>(Frames)>;  // no frames: no answer

struct RouterOptions {
  std::size_t max_frame_bytes = std::size_t{16} << 20;  // a peer that sends a larger one is cut off
  int queued_messages_per_peer = 4;                // a peer has one request in flight; the rest is slack for repeats
  bool insecure_plaintext = false;                 // listen where other machines can reach us, without authentication
  std::function<void(const std::string&)> log;     // a line per answer that found nobody; may be empty
};

struct RouterCounters {
  std::uint64_t received = 0;
  std::uint64_t sent = 0;
  std::uint64_t peer_gone = 0;  // answers whose peer had left
  std::uint64_t peer_full = 0;  // answers to a peer that does not read
};

class Router {
 public:
  explicit Router(RouterOptions options);
  Router(const Router&) = delete;
  Router& operator=(const Router&) = delete;
  ~Router();  // waits for answers on their way (a second at most) and for sockets that others made in context()

  void* context() { return context_.handle(); }  // to reach inproc endpoints

  // Returns the endpoint as bound (with its port where "*" was given). Throws std::invalid_argument for an endpoint
  // that must not be bound, std::runtime_error where it cannot be.
  std::string bind(const std::string& endpoint);

  // Answers requests until `stop_fd` is readable. A request that is being answered is answered to the end.
  void run(const Handler& handler, int stop_fd);

  // Answers what has arrived by now, at most `limit` requests, and returns.
  void answer_waiting(const Handler& handler, std::size_t limit);

  const RouterCounters& counters() const { return counters_; }

 private:
  class PathLock;  // of an ipc path: held for as long as the socket is

  bool answer_one(const Handler& handler);
  bool receive(zmq::message_t& frame);
  void send(zmq::message_t& peer, const std::vector<OutFrame>& frames);

  RouterOptions options_;
  std::vector<PathLock> locks_;  // outlive the context, which may hold sockets there
  zmq::context_t context_;
  zmq::socket_t socket_;
  RouterCounters counters_;
};

}  // namespace shearbus::transport
