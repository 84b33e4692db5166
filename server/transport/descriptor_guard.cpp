#include "server/transport/descriptor_guard.hpp"

#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <string_view>
#include <vector>

namespace shearbus::transport {
namespace {

constexpr std::size_t kLargestTable = std::size_t{1} << 16;  // peers get no descriptors above four fifths of this

// Returns a number that distinguishes a socket from a later one with the same descriptor; 0 for other files.
std::uint64_t cookie_of(int file) {
  std::uint64_t cookie = 0;
  socklen_t size = sizeof cookie;
  return ::getsockopt(file, SOL_SOCKET, SO_COOKIE, &cookie, &size) == 0 ? cookie : 0;
}

// Whether the bytes are the command READY: flags, length, length of the name, name.
bool is_ready(std::string_view bytes) {
  return bytes.size() >= 8 && bytes[0] == '\x04' && bytes.substr(2).starts_with("\5READY");
}

class Guard {
 public:
  void begin() {
    const std::lock_guard lock(mutex_);
    if (active_.load()) return;
    rlimit limit{};
    ::getrlimit(RLIMIT_NOFILE, &limit);
    connections_ = std::vector<Connection>(std::min<std::size_t>(limit.rlim_cur, kLargestTable));
    active_.store(true, std::memory_order_release);
  }

  // Whether a socket that was just accepted may stay.
  bool accepted(int file) {
    if (!active_.load(std::memory_order_acquire)) return true;
    const std::lock_guard lock(mutex_);
    // The kernel gives the lowest free descriptor, so its number tells how many are in use.
    if (5 * static_cast<std::size_t>(file) >= 4 * connections_.size()) {
      ++counters_.out_of_descriptors;
      return false;
    }
    Connection& connection = connections_[static_cast<std::size_t>(file)];
    connection.cookie = cookie_of(file);
    connection.bytes.store(1, std::memory_order_relaxed);
    Place& place = places_[next_place_++ % places_.size()];
    displace(place);
    place = {file, connection.cookie};
    return true;
  }

  // Whether a socket that has received `bytes` may go on.
  bool received(int file, std::size_t bytes) {
    Connection* const connection = unadmitted(file);
    if (connection == nullptr) return true;
    if (connection->bytes.fetch_add(bytes, std::memory_order_relaxed) + bytes <= kBytesBeforeAdmission) return true;
    const std::lock_guard lock(mutex_);
    if (cookie_of(file) != connection->cookie) {  // another file, since the accepted socket was closed
      connection->bytes.store(0, std::memory_order_relaxed);
      return true;
    }
    ++counters_.too_many_bytes;
    return false;
  }

  void sent(int file, std::string_view bytes) {
    if (Connection* const connection = unadmitted(file); connection != nullptr && is_ready(bytes))
      connection->bytes.store(0, std::memory_order_relaxed);
  }

  bool end(int file) {
    const std::lock_guard lock(mutex_);
    if (!active_.load() || file < 0 || static_cast<std::size_t>(file) >= connections_.size()) return false;
    const std::uint64_t cookie = connections_[static_cast<std::size_t>(file)].cookie;
    return cookie != 0 && cookie == cookie_of(file) && ::shutdown(file, SHUT_RDWR) == 0;
  }

  GuardCounters counters() {
    const std::lock_guard lock(mutex_);
    return counters_;
  }

 private:
  struct Connection {
    std::atomic<std::uint64_t> bytes{0};  // 1 + number of bytes received before admission; 0: not guarded
    std::uint64_t cookie = 0;
  };
  struct Place {
    int file = -1;
    std::uint64_t cookie = 0;
  };

  Connection* unadmitted(int file) {
    if (!active_.load(std::memory_order_acquire) || file < 0) return nullptr;
    const auto index = static_cast<std::size_t>(file);
    if (index >= connections_.size() || connections_[index].bytes.load(std::memory_order_relaxed) == 0) return nullptr;
    return &connections_[index];
  }

  // Ends the connection of a place if it is not admitted yet. libzmq then finds the end of the stream, and closes.
  void displace(const Place& place) {
    const Connection* const connection = unadmitted(place.file);
    if (connection == nullptr || connection->cookie != place.cookie || cookie_of(place.file) != place.cookie) return;
    ::shutdown(place.file, SHUT_RDWR);
    ++counters_.displaced;
  }

  std::mutex mutex_;  // not needed for admitted connections
  std::atomic<bool> active_{false};
  std::vector<Connection> connections_;                 // by descriptor
  std::array<Place, kUnadmittedConnections> places_{};  // of the last accepted connections, in a ring
  std::size_t next_place_ = 0;
  GuardCounters counters_;
};

// Never destroyed: threads of libzmq may run longer than static objects live.
Guard& guard() {
  static auto* const only = new Guard;
  return *only;
}

}  // namespace

void begin_descriptor_guard() {
  guard().begin();
}
GuardCounters descriptor_guard_counters() {
  return guard().counters();
}
bool end_connection(int file) {
  return guard().end(file);
}

}  // namespace shearbus::transport

extern "C" {

__attribute__((visibility("default"))) int accept4(int listener, sockaddr* address, socklen_t* size, int flags) {
  const int file = static_cast<int>(::syscall(SYS_accept4, listener, address, size, flags));
  if (file < 0) {
    if (errno == EMFILE) errno = ENFILE;  // libzmq handles both alike but for the assertion
    return file;
  }
  if (shearbus::transport::guard().accepted(file)) return file;
  ::close(file);
  errno = ECONNABORTED;
  return -1;
}

// The result 0 means that the peer has closed the connection, and libzmq then closes it, too.
__attribute__((visibility("default"))) ssize_t recv(int file, void* bytes, size_t size, int flags) {
  const ssize_t received = ::syscall(SYS_recvfrom, file, bytes, size, flags, nullptr, nullptr);
  if (received > 0 && !shearbus::transport::guard().received(file, static_cast<std::size_t>(received))) return 0;
  return received;
}

__attribute__((visibility("default"))) ssize_t send(int file, const void* bytes, size_t size, int flags) {
  const ssize_t sent = ::syscall(SYS_sendto, file, bytes, size, flags, nullptr, 0);
  if (sent > 0) shearbus::transport::guard().sent(file, {static_cast<const char*>(bytes), size});
  return sent;
}
}
