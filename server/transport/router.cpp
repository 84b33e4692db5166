#include "server/transport/router.hpp"

#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <tuple>
#include <utility>

#include "server/transport/descriptor_guard.hpp"
#include "server/transport/endpoint.hpp"
#include "server/transport/socket_path.hpp"

namespace shearbus::transport {
namespace {

constexpr std::size_t kCopiedUpTo = std::size_t{16} * 1024;       // largest frame that is copied  [bytes]
constexpr std::size_t kMostWaiting = 1024;                        // most messages that wait for others
constexpr std::size_t kMostWaitingBytes = std::size_t{64} << 20;  // and their size
constexpr int kAnswersBeforePoll = 8;  // number of answers after which the stop signal is checked again

// longest queue of pending connections; the kernel drops further connection attempts, which the peers then repeat
constexpr int kBacklog = 4096;
constexpr int kHandshakeMs = 5'000;
constexpr int kHeartbeatMs = 2'000;
constexpr int kHeartbeatTimeoutMs = 6'000;
constexpr int kKeepaliveIdleS = 60;
constexpr int kLingerMs = 1'000;  // longest wait at the end until peers have read their answers

// Returns a property of the sender, which libzmq attaches to each frame after the first; null if it has no such
// property.
const char* property(zmq::message_t& frame, const char* name) {
  return zmq_msg_gets(frame.handle(), name);
}

zmq::message_t message_of(const OutFrame& frame) {
  if (frame.bytes.size() <= kCopiedUpTo || !frame.owner) return {frame.bytes.data(), frame.bytes.size()};
  auto owner = std::make_unique<std::shared_ptr<const void>>(frame.owner);
  // libzmq's interface takes a pointer to non-const but does not change the object.
  zmq::message_t message(
      const_cast<std::byte*>(frame.bytes.data()), frame.bytes.size(),
      [](void*, void* hint) { delete static_cast<std::shared_ptr<const void>*>(hint); }, owner.get());
  static_cast<void>(owner.release());
  return message;
}

}  // namespace

// The options set here hold for all endpoints. They are set before the first bind, because a change affects later binds
// only.
Router::Router(RouterOptions options)
    : options_((wire::check_room_for_sockets(), std::move(options))), socket_(context_, zmq::socket_type::router) {
  socket_.set(zmq::sockopt::router_mandatory, true);  // an undeliverable answer is an error instead of being dropped
  socket_.set(zmq::sockopt::sndhwm, options_.queued_messages_per_peer);
  socket_.set(zmq::sockopt::rcvhwm, options_.queued_messages_per_peer);
  socket_.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(options_.max_frame_bytes));
  socket_.set(zmq::sockopt::backlog, kBacklog);
  socket_.set(zmq::sockopt::handshake_ivl, kHandshakeMs);
  socket_.set(zmq::sockopt::heartbeat_ivl, kHeartbeatMs);
  socket_.set(zmq::sockopt::heartbeat_timeout, kHeartbeatTimeoutMs);
  socket_.set(zmq::sockopt::tcp_keepalive, 1);
  socket_.set(zmq::sockopt::tcp_keepalive_idle, kKeepaliveIdleS);
  socket_.set(zmq::sockopt::linger, kLingerMs);
}

Router::~Router() = default;

std::string Router::bind(const std::string& text) {
  const Endpoint endpoint = Endpoint::parse(text);
  try {
    switch (endpoint.scheme) {
      case Scheme::kIpc:
        bind_ipc(endpoint);
        break;
      case Scheme::kTcp:
        bind_tcp(endpoint);
        break;
      case Scheme::kInproc:
        bind_socket(text);
        serves_own_process_ = true;
        break;
    }
  } catch (const zmq::error_t& fault) {
    throw std::runtime_error("cannot listen on " + text + ": " +
                             (fault.num() == ENODEV
                                  ? "\"" + endpoint.host +
                                        "\" is neither an address nor a network interface of this machine; names of "
                                        "hosts are not looked up. For this machine alone: tcp://127.0.0.1:" +
                                        endpoint.port
                                  : fault.what()));
  }
  return socket_.get(zmq::sockopt::last_endpoint);
}

void Router::bind_ipc(const Endpoint& endpoint) {
  SocketPath path(endpoint.path, options_.ipc_users.empty());
  listen_at(path, endpoint.text);
  if (!path.admit(options_.ipc_users) && options_.log_access)
    options_.log_access("WARNING: the file system of " + endpoint.path +
                        " has no access lists: every user of this machine can connect there, and is refused then "
                        "unless --allow-uid names the user");
  paths_.push_back({.path = std::move(path), .endpoint = endpoint.text});
}

void Router::listen_at(SocketPath& path, const std::string& endpoint) {
  socket_.set(zmq::sockopt::curve_server, false);
  guard(Peer::Way::kIpc);
  const struct Umask {  // and with it the permissions of the socket's file
    mode_t before = ::umask(077);
    ~Umask() { ::umask(before); }
  } umask;
  bind_socket(endpoint);
  path.remember();
}

// A second bind of the path leaves the first listener as it is: without a file nobody reaches it, and its connections
// stay. To unbind it would close them.
std::vector<std::string> Router::look_after_paths() {
  std::vector<std::string> lines;
  for (Listener& listener : paths_) {
    if (listener.path.stands()) continue;
    try {
      listener.path.take_again(options_.ipc_users.empty());
      listen_at(listener.path, listener.endpoint);
      static_cast<void>(listener.path.admit(options_.ipc_users));
      listener.fault.clear();
      lines.push_back("ALARM: the socket " + listener.endpoint +
                      " was removed, so that no new client could connect; it was made again. Whoever cleans that "
                      "directory should leave it out");
    } catch (const std::exception& fault) {
      const std::string line = "ALARM: the socket " + listener.endpoint +
                               " was removed: no new client can connect, and it cannot be made again: " + fault.what();
      if (line != listener.fault) lines.push_back(line);
      listener.fault = line;
    }
  }
  return lines;
}

void Router::bind_tcp(const Endpoint& endpoint) {
  const bool curve = !options_.curve_secret_key.empty();
  if (!curve && !options_.insecure_plaintext) endpoint.refuse_unprotected();
  socket_.set(zmq::sockopt::ipv6, endpoint.host.find(':') != std::string::npos);
  if (curve) socket_.set(zmq::sockopt::curve_secretkey, options_.curve_secret_key);
  socket_.set(zmq::sockopt::curve_server, curve);  // selects the mechanism of the next bind: CURVE or none
  guard(curve ? Peer::Way::kCurve : Peer::Way::kPlaintext);
  bind_socket(endpoint.text);
}

void Router::bind_socket(const std::string& endpoint) {
  if (wire::uninterrupted([&] { return zmq_bind(socket_.handle(), endpoint.c_str()); }) != 0) throw zmq::error_t();
}

// Reading this option makes libzmq process what its other threads have told it. A signal may interrupt that.
void Router::process_events() {
  int events = 0;
  std::size_t size = sizeof events;
  wire::uninterrupted([&] { return zmq_getsockopt(socket_.handle(), ZMQ_EVENTS, &events, &size); });
}

void Router::guard(Peer::Way way) {
  begin_descriptor_guard();
  if (!access_) access_ = std::make_unique<AccessHandler>(context_, options_.authorise, options_.log_access);
  AccessHandler::guard(socket_, way);
}

// zmq_poll() would look at the socket before and after it sleeps, and ask the kernel each time. Here the file of the
// socket is enough: the last call of receive() before has found no message, and libzmq makes the file readable when it
// has something to tell after that.
bool Router::sleep(int stop_fd, int wait_ms, const wire::Event* wake) {
  std::array<pollfd, 3> files = {{{.fd = socket_.get(zmq::sockopt::fd), .events = POLLIN, .revents = 0},
                                  {.fd = stop_fd, .events = POLLIN, .revents = 0},
                                  {.fd = wake != nullptr ? wake->file() : -1, .events = POLLIN, .revents = 0}}};
  if (::poll(files.data(), files.size(), wait_ms) < 0 && errno != EINTR)
    throw std::system_error(errno, std::generic_category(), "the server cannot wait for messages");
  if (files[2].revents != 0) wake->clear();
  return files[1].revents == 0;
}

void Router::run(const Handler& handler, int stop_fd, const Pulse& pulse) {
  bool drained = false;  // no message waited when the socket was looked at last
  for (;;) {
    bool busy = pulse.busy && pulse.busy();
    if (!sleep(stop_fd, busy || !drained ? 0 : pulse.every_ms, pulse.wake)) return;
    busy = busy || (pulse.busy && pulse.busy());  // it may have become so while the router waited
    drained = false;
    for (int i = 0; i < kAnswersBeforePoll && !drained; ++i) drained = !answer_one(handler);
    if (busy && pulse.work()) {
      answer_held(handler);
      drained = false;  // libzmq may have taken notice of a message when it sent the answers
    }
    if (pulse.beat && !pulse.beat()) return;
  }
}

void Router::answer_waiting(const Handler& handler, std::size_t limit) {
  for (std::size_t i = 0; i < limit && answer_one(handler); ++i) {
  }
}

std::size_t Router::Message::bytes() const {
  std::size_t sum = 0;
  for (const zmq::message_t& frame : frames) sum += frame.size();
  return sum;
}

// Receives one message and answers it. Returns false if no message waits.
bool Router::answer_one(const Handler& handler) {
  if (!next_) next_ = std::make_unique<Message>();
  Message& message = *next_;
  if (!receive(message.peer)) return false;
  message.count = 0;
  bool more = message.peer.more();
  while (more) {
    zmq::message_t surplus;
    zmq::message_t& frame = message.count < message.frames.size() ? message.frames[message.count++] : surplus;
    if (!receive(frame)) break;  // libzmq delivers whole messages, so the remaining frames are available
    more = frame.more();
  }
  ++counters_.received;
  // A message without a user is dropped unless it comes from this process: its sender has not passed the access
  // handler.
  const char* user = message.count != 0 ? property(message.frames[0], "User-Id") : nullptr;
  if (user == nullptr &&
      (!serves_own_process_ || message.count == 0 || property(message.frames[0], "Peer-Address") != nullptr)) {
    ++counters_.without_user;
    return true;
  }
  message.user = user != nullptr ? user : "";
  if (!options_.curve_secret_key.empty() && user != nullptr) remember_connection(message);
  ask(handler, next_);
  return true;
}

// libzmq tells the descriptor of a message's connection, and has no call that closes one connection.
void Router::remember_connection(Message& message) {
  constexpr std::size_t kMostFiles = std::size_t{1} << 16;
  const int file = zmq_msg_get(message.frames[0].handle(), ZMQ_SRCFD);
  if (file < 0 || static_cast<std::size_t>(file) >= kMostFiles) return;
  const auto place = static_cast<std::size_t>(file);
  if (place >= users_of_files_.size()) users_of_files_.resize(place + 1);
  if (users_of_files_[place] != message.user) users_of_files_[place] = message.user;
}

std::size_t Router::end_connections(const std::function<bool(std::string_view user)>& are_out) {
  std::size_t ended = 0;
  for (std::size_t file = 0; file < users_of_files_.size(); ++file) {
    std::string& user = users_of_files_[file];
    if (user.empty() || !are_out(user)) continue;
    ended += end_connection(static_cast<int>(file)) ? 1 : 0;
    user.clear();
  }
  return ended;
}

// Hands the message to the handler, and keeps it if the handler wants it again.
void Router::ask(const Handler& handler, std::unique_ptr<Message>& message) {
  std::array<std::span<const std::byte>, kMaxFrames + 1> views;
  for (std::size_t i = 0; i < message->count; ++i)
    views[i] = {static_cast<const std::byte*>(message->frames[i].data()), message->frames[i].size()};
  const Answer answer = handler(Frames(views.data(), message->count), message->user);
  if (answer.kind != Answer::Kind::kDone)
    hold(std::move(message), answer.kind);
  else if (answer.count != 0)
    send(message->peer, answer);
}

void Router::hold(std::unique_ptr<Message> message, Answer::Kind kind) {
  message->must_stay = message->must_stay || kind == Answer::Kind::kKept;
  if (!message->must_stay) {
    const std::size_t bytes = message->bytes();
    if (waiting_ == kMostWaiting || bytes > kMostWaitingBytes - waiting_bytes_) {
      ++counters_.dropped;
      return;
    }
    ++waiting_;
    waiting_bytes_ += bytes;
  }
  held_.push_back(std::move(message));
}

void Router::answer_held(const Handler& handler) {
  std::deque<std::unique_ptr<Message>> held = std::move(held_);
  held_.clear();
  waiting_ = waiting_bytes_ = 0;
  for (std::unique_ptr<Message>& message : held) ask(handler, message);
}

bool Router::receive(zmq::message_t& frame) {
  if (wire::uninterrupted([&] { return zmq_msg_recv(frame.handle(), socket_.handle(), ZMQ_DONTWAIT); }) >= 0)
    return true;
  if (zmq_errno() == EAGAIN) return false;
  throw zmq::error_t();
}

// Sends without waiting. Only the sending of the routing id can fail: once libzmq has accepted it, libzmq accepts the
// other frames of the message.
void Router::send(zmq::message_t& peer, const Answer& answer) {
  const auto send_frame = [&](zmq::message_t& frame, bool more) {
    const int flags = ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0);
    if (wire::uninterrupted([&] { return zmq_msg_send(frame.handle(), socket_.handle(), flags); }) >= 0) return true;
    if (zmq_errno() == EHOSTUNREACH || zmq_errno() == EAGAIN) return false;
    throw zmq::error_t();
  };
  std::array<zmq::message_t, std::tuple_size_v<decltype(answer.frames)>> messages;
  for (std::size_t i = 0; i < answer.count; ++i) messages[i] = message_of(answer.frames[i]);

  bool accepted = send_frame(peer, true);
  if (!accepted && zmq_errno() == EAGAIN) {
    // The peer may have read meanwhile: libzmq processes that notice only now and then, and a non-blocking send to a
    // full queue fails without processing it. Without this call about one answer in a hundred was lost.
    process_events();
    accepted = send_frame(peer, true);
  }
  if (!accepted) {
    const bool gone = zmq_errno() == EHOSTUNREACH;
    ++(gone ? counters_.peer_gone : counters_.peer_full);
    if (options_.log) options_.log(gone ? "an answer found its peer gone" : "an answer found its peer not reading");
    return;
  }
  for (std::size_t i = 0; i < answer.count; ++i)
    if (!send_frame(messages[i], i + 1 < answer.count)) return;
  ++counters_.sent;
}

}  // namespace shearbus::transport
