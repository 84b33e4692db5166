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
#include <string_view>
#include <vector>
#include <zmq.hpp>

#include "server/transport/access.hpp"
#include "server/transport/endpoint.hpp"
#include "server/transport/socket_path.hpp"

namespace shearbus::transport {

// A frame to send. Small ones are copied; of large ones `owner` keeps the bytes alive until the network has them.
struct OutFrame {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
};

using Frames = std::span<const std::span<const std::byte>>;
// `user` is what the access handler called the peer; empty: it is of this process. No frames: no answer.
using Handler = std::function<std::vector<OutFrame>(Frames, std::string_view user)>;

// What a router does between requests.
struct Pulse {
  int every_ms = -1;           // at least so often, also where nothing arrives; -1: only after requests
  std::function<bool()> beat;  // false: the run ends; may be empty
};

struct RouterOptions {
  std::size_t max_frame_bytes = std::size_t{16} << 20;  // a peer that sends a larger one is cut off
  int queued_messages_per_peer = 4;             // a peer has one request in flight; the rest is slack for repeats
  Authorise authorise;                          // who may connect by ipc and tcp
  bool ipc_for_others = false;                  // other users may reach an ipc socket: `authorise` knows which
  std::string curve_secret_key;                 // Z85; tcp peers must have keys. Empty: they have none, and
  bool insecure_plaintext = false;              // tcp is refused unless this is set
  std::function<void(const std::string&)> log;  // a line per answer that found nobody; may be empty
  std::function<void(const std::string&)> log_access;  // a line per refused connection, from another thread; likewise
};

struct RouterCounters {
  std::uint64_t received = 0;
  std::uint64_t sent = 0;
  std::uint64_t peer_gone = 0;     // answers whose peer had left
  std::uint64_t peer_full = 0;     // answers to a peer that does not read
  std::uint64_t without_user = 0;  // messages dropped because nobody has let their peer in
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

  // Answers requests until `stop_fd` is readable or the pulse says so. A request that is being answered is answered to
  // the end.
  void run(const Handler& handler, int stop_fd, const Pulse& pulse = {});

  // Answers what has arrived by now, at most `limit` requests, and returns.
  void answer_waiting(const Handler& handler, std::size_t limit);

  const RouterCounters& counters() const { return counters_; }
  const AccessHandler* access() const { return access_.get(); }  // null while there is inproc only

 private:
  void bind_ipc(const Endpoint& endpoint);
  void bind_tcp(const Endpoint& endpoint);
  void guard(Peer::Way way);  // of the next bind
  bool answer_one(const Handler& handler);
  bool receive(zmq::message_t& frame);
  void send(zmq::message_t& peer, const std::vector<OutFrame>& frames);

  RouterOptions options_;
  std::vector<SocketPath> paths_;  // outlive the context, which may hold sockets there
  zmq::context_t context_;
  std::unique_ptr<AccessHandler> access_;
  zmq::socket_t socket_;
  bool serves_own_process_ = false;
  RouterCounters counters_;
};

}  // namespace shearbus::transport
