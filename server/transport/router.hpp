// The only socket of the server: a ROUTER that passes messages to a handler and sends its answers back. It does not
// interpret the bytes. It belongs to one thread, which need not be the constructing thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>
#include <zmq.hpp>

#include "proto/wire/host_process.hpp"
#include "server/transport/access.hpp"
#include "server/transport/endpoint.hpp"
#include "server/transport/socket_path.hpp"

namespace shearbus::transport {

// A frame to send. `owner` keeps the bytes of a large frame alive until they are sent. The bytes of small frames and of
// those without an owner are copied when the handler has returned.
struct OutFrame {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
};

using Frames = std::span<const std::span<const std::byte>>;
// What a handler makes of a message.
struct Answer {
  enum class Kind {
    kDone,  // the frames are the answer; without frames there is none
    kKept,  // the message is needed where it is in memory, and is handed to the handler again
    kHeld   // the message is handed to the handler again; it may be dropped, because its sender will repeat it
  };
  Answer() = default;
  explicit Answer(Kind what) : kind(what) {}
  explicit Answer(OutFrame header) : frames{std::move(header)}, count(1) {}
  Answer(OutFrame header, OutFrame payload) : frames{std::move(header), std::move(payload)}, count(2) {}

  Kind kind = Kind::kDone;
  std::array<OutFrame, 2> frames;
  std::size_t count = 0;
};
// Answers a message. `user` is the name that the access handler gave the peer; it is empty for a peer inside this
// process.
using Handler = std::function<Answer(Frames, std::string_view user)>;

// Work that the router does between requests.
struct Pulse {
  int every_ms = -1;           // longest wait between two calls of `beat`; -1: called after requests only
  std::function<bool()> beat;  // does the work and returns false to end the run; may be empty
  // Work that goes on while messages arrive. While busy() the router does not wait for messages, and calls work() after
  // it has answered those that there are. After work() has returned true it hands messages to the handler again. May be
  // empty.
  std::function<bool()> busy;
  std::function<bool()> work;
  const wire::Event* wake = nullptr;  // called when busy() may have become true while the router waits; may be null
};

struct RouterOptions {
  std::size_t max_frame_bytes = std::size_t{16} << 20;  // a peer that sends a larger frame is disconnected
  // Most messages queued for a peer. libzmq wakes the other side whenever half of them were taken.
  int queued_messages_per_peer = 8;
  Authorise authorise;                   // decides who may connect by ipc and tcp
  std::vector<std::uint32_t> ipc_users;  // users who may reach an ipc socket besides the server's own
  std::string curve_secret_key;     // the server's secret key in Z85; tcp peers then need keys, too; empty: no keys
  bool insecure_plaintext = false;  // allows tcp without keys, which is refused otherwise
  std::function<void(const std::string&)> log;         // gets a line per undeliverable answer; may be empty
  std::function<void(const std::string&)> log_access;  // gets a line per refused connection, on another thread
};

struct RouterCounters {
  std::uint64_t received = 0;
  std::uint64_t sent = 0;
  std::uint64_t peer_gone = 0;     // number of answers to a peer that had disconnected
  std::uint64_t peer_full = 0;     // number of answers to a peer that does not read
  std::uint64_t without_user = 0;  // number of messages dropped because their peer was never admitted
  std::uint64_t dropped = 0;       // number of messages dropped because too many waited already
};

class Router {
 public:
  explicit Router(RouterOptions options);
  Router(const Router&) = delete;
  Router& operator=(const Router&) = delete;
  ~Router();  // waits for pending answers (one second at most) and for sockets that others opened in context()

  void* context() { return context_.handle(); }  // context for clients on inproc endpoints

  // Returns the endpoint as bound, with its port if "*" was given. Throws std::invalid_argument for an endpoint that
  // must not be bound, std::runtime_error if the bind fails.
  std::string bind(const std::string& endpoint);

  // Looks whether the files of ipc endpoints are still those that were made, and makes and binds lost ones again.
  // Connections stay. Returns a line for the log for each change. To be called now and then.
  std::vector<std::string> look_after_paths();

  // Ends the connections by which users of keys have sent messages that `are_out` names. Returns their number.
  std::size_t end_connections(const std::function<bool(std::string_view user)>& are_out);

  // Answers requests until `stop_fd` is readable or `pulse.beat` returns false. A request in progress is completed
  // first.
  void run(const Handler& handler, int stop_fd, const Pulse& pulse = {});

  // Hands the messages that wait to the handler again, in the order of their arrival.
  void answer_held(const Handler& handler);

  // Answers the requests that have arrived, at most `limit`, and returns.
  void answer_waiting(const Handler& handler, std::size_t limit);

  const RouterCounters& counters() const { return counters_; }
  const AccessHandler* access() const { return access_.get(); }  // null if no ipc or tcp endpoint is bound

 private:
  static constexpr std::size_t kMaxFrames = 2;  // largest number of frames of a request, without the routing id
  // A message as received. One frame more than the limit is kept, so that the handler sees that the limit is exceeded.
  struct Message {
    zmq::message_t peer;
    std::array<zmq::message_t, kMaxFrames + 1> frames;
    std::size_t count = 0;
    std::string user;
    bool must_stay = false;  // the handler needs the message in memory
    std::size_t bytes() const;
  };

  void bind_ipc(const Endpoint& endpoint);
  void listen_at(SocketPath& path, const std::string& endpoint);
  void bind_tcp(const Endpoint& endpoint);
  void guard(Peer::Way way);  // makes the access handler judge every peer of the endpoint that is bound next
  bool answer_one(const Handler& handler);
  void remember_connection(Message& message);
  void ask(const Handler& handler, std::unique_ptr<Message>& message);
  void hold(std::unique_ptr<Message> message, Answer::Kind kind);
  void bind_socket(const std::string& endpoint);
  void process_events();
  bool receive(zmq::message_t& frame);
  bool sleep(int stop_fd, int wait_ms, const wire::Event* wake);  // false: stop_fd is readable
  void send(zmq::message_t& peer, const Answer& answer);

  RouterOptions options_;
  struct Listener {
    SocketPath path;
    std::string endpoint;
    std::string fault;  // why it could not be made again at the last look
  };
  std::vector<Listener> paths_;  // must outlive the context, which may have open sockets at these paths
  zmq::context_t context_;
  std::unique_ptr<AccessHandler> access_;
  zmq::socket_t socket_;
  bool serves_own_process_ = false;
  std::vector<std::string> users_of_files_;    // the last user of each connection, by its descriptor; with keys only
  std::unique_ptr<Message> next_;              // receives the next message
  std::deque<std::unique_ptr<Message>> held_;  // messages that are handed to the handler again, oldest first
  std::size_t waiting_ = 0;                    // number of those that may be dropped, and their size
  std::size_t waiting_bytes_ = 0;
  RouterCounters counters_;
};

}  // namespace shearbus::transport
