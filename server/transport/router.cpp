#include "server/transport/router.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "server/transport/endpoint.hpp"

namespace shearbus::transport {
namespace {

constexpr std::size_t kMaxFrames = 2;           // of a request, after the peer's routing id
constexpr std::size_t kCopiedUpTo = std::size_t{16} * 1024;  // below this a copy is cheaper than a counted reference
constexpr int kAnswersBeforePoll = 8;           // so that a busy bus cannot hide the stop signal

constexpr int kHandshakeMs = 5'000;
constexpr int kHeartbeatMs = 2'000;
constexpr int kHeartbeatTimeoutMs = 6'000;
constexpr int kKeepaliveIdleS = 60;
constexpr int kLingerMs = 1'000;  // an answer that was given is sent; a peer that does not read holds us up no longer

// Whoever can open an ipc socket is served: it is made with no rights for others.
class PrivateUmask {
 public:
  PrivateUmask() : previous_(::umask(077)) {}
  PrivateUmask(const PrivateUmask&) = delete;
  PrivateUmask& operator=(const PrivateUmask&) = delete;
  ~PrivateUmask() { ::umask(previous_); }

 private:
  mode_t previous_;
};

zmq::message_t message_of(const OutFrame& frame) {
  if (frame.bytes.size() <= kCopiedUpTo) return {frame.bytes.data(), frame.bytes.size()};
  auto owner = std::make_unique<std::shared_ptr<const void>>(frame.owner);
  // libzmq's interface takes a pointer to what it could change; it does not.
  zmq::message_t message(
      const_cast<std::byte*>(frame.bytes.data()), frame.bytes.size(),
      [](void*, void* hint) { delete static_cast<std::shared_ptr<const void>*>(hint); }, owner.get());
  static_cast<void>(owner.release());
  return message;
}

}  // namespace

// libzmq would unlink a path in use and take it over, leaving the first server deaf.
class Router::PathLock {
 public:
  explicit PathLock(const std::string& path) : path_(path) {
    struct stat existing {};
    if (::lstat(path.c_str(), &existing) == 0 && !S_ISSOCK(existing.st_mode))
      throw std::runtime_error("ipc://" + path +
                               " is a file or directory, not a socket: listening there would delete it; "
                               "choose another path");
    const std::string lock = path + ".lock";
    file_ = ::open(lock.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (file_ < 0)
      throw std::runtime_error("cannot open lock file " + lock + ": " + std::strerror(errno) +
                               "; the directory must exist and be writable");
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
      const int fault = errno;
      ::close(file_);
      if (fault == EWOULDBLOCK)
        throw std::runtime_error("another server listens on ipc://" + path + " (it holds " + lock +
                                 "); stop it first, or choose another path");
      throw std::runtime_error("cannot lock " + lock + ": " + std::strerror(fault));
    }
  }
  PathLock(PathLock&& other) noexcept : path_(std::move(other.path_)), file_(std::exchange(other.file_, -1)) {}
  PathLock& operator=(PathLock&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(file_, other.file_);
    return *this;
  }
  // libzmq leaves the socket's name behind; while the lock is held nobody else's can be there. The lock file stays:
  // removing it would race with a server that has just opened it.
  ~PathLock() {
    if (file_ < 0) return;
    ::unlink(path_.c_str());
    ::close(file_);
  }

 private:
  std::string path_;
  int file_ = -1;
};

// Everything is set before the first bind: later changes would hold for later binds only.
Router::Router(RouterOptions options) : options_(std::move(options)), socket_(context_, zmq::socket_type::router) {
  socket_.set(zmq::sockopt::router_mandatory, true);  // an answer that cannot go out is an error, not silence
  socket_.set(zmq::sockopt::sndhwm, options_.queued_messages_per_peer);
  socket_.set(zmq::sockopt::rcvhwm, options_.queued_messages_per_peer);
  socket_.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(options_.max_frame_bytes));
  socket_.set(zmq::sockopt::handshake_ivl, kHandshakeMs);
  socket_.set(zmq::sockopt::heartbeat_ivl, kHeartbeatMs);
  socket_.set(zmq::sockopt::heartbeat_timeout, kHeartbeatTimeoutMs);
  socket_.set(zmq::sockopt::tcp_keepalive, 1);
  socket_.set(zmq::sockopt::tcp_keepalive_idle, kKeepaliveIdleS);
  socket_.set(zmq::sockopt::linger, kLingerMs);
  // With a domain libzmq takes no peers of ZMTP 1 and 2, whose bytes would reach us without a handshake.
  socket_.set(zmq::sockopt::zap_domain, "shearbus");
}

Router::~Router() = default;

std::string Router::bind(const std::string& text) {
  const Endpoint endpoint = Endpoint::parse(text);
  if (endpoint.scheme == Scheme::kTcp && !endpoint.loopback && !options_.insecure_plaintext)
    throw std::invalid_argument("endpoint \"" + text +
                                "\" can be reached from other machines, and this server does not authenticate clients; "
                                "use ipc:// or tcp://127.0.0.1:PORT, or accept that with --insecure-plaintext");
  if (endpoint.scheme == Scheme::kTcp && endpoint.host.find(':') != std::string::npos)
    socket_.set(zmq::sockopt::ipv6, true);
  try {
    if (endpoint.scheme == Scheme::kIpc) {
      PathLock lock(endpoint.path);
      const PrivateUmask umask;
      socket_.bind(text);
      locks_.push_back(std::move(lock));
    } else {
      socket_.bind(text);
    }
  } catch (const zmq::error_t& fault) {
    throw std::runtime_error("cannot listen on " + text + ": " + fault.what());
  }
  return socket_.get(zmq::sockopt::last_endpoint);
}

void Router::run(const Handler& handler, int stop_fd) {
  std::array<zmq::pollitem_t, 2> items = {{{socket_.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, stop_fd, ZMQ_POLLIN, 0}}};
  for (;;) {
    if (zmq_poll(items.data(), static_cast<int>(items.size()), -1) < 0) {
      if (zmq_errno() == EINTR) continue;
      throw zmq::error_t();
    }
    if ((items[1].revents & ZMQ_POLLIN) != 0) return;
    for (int i = 0; i < kAnswersBeforePoll && answer_one(handler); ++i) {
    }
  }
}

void Router::answer_waiting(const Handler& handler, std::size_t limit) {
  for (std::size_t i = 0; i < limit && answer_one(handler); ++i) {
  }
}

// Takes one message off the socket and answers it; false when there is none.
bool Router::answer_one(const Handler& handler) {
  zmq::message_t peer;
  if (!receive(peer)) return false;
  // One frame more than is allowed is kept, so that the handler sees that there were too many; the rest is dropped as
  // it comes.
  std::array<zmq::message_t, kMaxFrames + 1> frames;
  std::size_t count = 0;
  bool more = peer.more();
  while (more) {
    zmq::message_t surplus;
    zmq::message_t& frame = count < frames.size() ? frames[count++] : surplus;
    if (!receive(frame)) break;  // libzmq delivers whole messages: the rest of this one is here
    more = frame.more();
  }
  ++counters_.received;

  std::array<std::span<const std::byte>, kMaxFrames + 1> views;
  for (std::size_t i = 0; i < count; ++i)
    views[i] = {static_cast<const std::byte*>(frames[i].data()), frames[i].size()};
  const std::vector<OutFrame> answer = handler(Frames(views.data(), count));
  if (!answer.empty()) send(peer, answer);
  return true;
}

bool Router::receive(zmq::message_t& frame) {
  for (;;) {
    if (zmq_msg_recv(frame.handle(), socket_.handle(), ZMQ_DONTWAIT) >= 0) return true;
    if (zmq_errno() == EAGAIN) return false;
    if (zmq_errno() != EINTR) throw zmq::error_t();
  }
}

// Never waits. The routing id decides: once libzmq has taken it, it takes the rest of the message as well.
void Router::send(zmq::message_t& peer, const std::vector<OutFrame>& frames) {
  const auto send_frame = [&](zmq::message_t& frame, bool more) {
    while (zmq_msg_send(frame.handle(), socket_.handle(), ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0)) < 0) {
      if (zmq_errno() == EINTR) continue;
      if (zmq_errno() == EHOSTUNREACH || zmq_errno() == EAGAIN) return false;
      throw zmq::error_t();
    }
    return true;
  };
  std::vector<zmq::message_t> messages;
  messages.reserve(frames.size());
  for (const OutFrame& frame : frames) messages.push_back(message_of(frame));

  bool accepted = send_frame(peer, true);
  if (!accepted && zmq_errno() == EAGAIN) {
    // The peer may have read long ago: libzmq looks for word of that only now and then, and a full queue that is not
    // asked to wait is reported without looking. Asking for events makes it look. Without this about one answer in a
    // hundred was lost.
    static_cast<void>(socket_.get(zmq::sockopt::events));
    accepted = send_frame(peer, true);
  }
  if (!accepted) {
    const bool gone = zmq_errno() == EHOSTUNREACH;
    ++(gone ? counters_.peer_gone : counters_.peer_full);
    if (options_.log) options_.log(gone ? "an answer found its peer gone" : "an answer found its peer not reading");
    return;
  }
  for (std::size_t i = 0; i < messages.size(); ++i)
    if (!send_frame(messages[i], i + 1 < messages.size())) return;
  ++counters_.sent;
}

}  // namespace shearbus::transport
