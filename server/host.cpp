#include "server/host.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <stdexcept>

#include "proto/wire/numbers.hpp"

namespace shearbus::server {
namespace {

constexpr std::uint64_t kCheckpointUs = 3'600'000'000;  // time asked of the service manager for a checkpoint  [µs]

std::uint64_t file_limit() {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  return limit.rlim_cur;
}

// Returns 0 if the variable is not set or is not a number.
std::uint64_t number_in_environment(const char* name) {
  const char* const text = std::getenv(name);
  return text != nullptr ? wire::count_of(text).value_or(0) : 0;
}

}  // namespace

std::uint64_t thread_cpu_ns() {
  timespec used{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return static_cast<std::uint64_t>(used.tv_sec) * 1'000'000'000 + static_cast<std::uint64_t>(used.tv_nsec);
}

std::uint64_t monotonic_ns() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

ProcessUse process_use() {
  ProcessUse use{.max_open_files = file_limit()};
  std::uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  use.resident_bytes = pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  if (DIR* files = ::opendir("/proc/self/fd")) {
    while (::readdir(files) != nullptr) ++use.open_files;
    ::closedir(files);
    use.open_files -= 3;  // leaves out ".", "..", and the descriptor of the directory that is read here
  }
  return use;
}

bool files_run_out() {
  // The lowest free descriptor estimates the number of open files without counting them.
  const wire::Descriptor lowest_free(::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0));
  if (lowest_free < 0) return errno == EMFILE;
  return 5 * static_cast<std::uint64_t>(lowest_free) >= 4 * file_limit();
}

ServiceManager::ServiceManager() {
  const char* path = std::getenv("NOTIFY_SOCKET");
  if (path == nullptr) return;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t length = std::strlen(path);
  if (length < 2 || length >= sizeof address.sun_path || (path[0] != '/' && path[0] != '@'))
    throw std::runtime_error(std::string("NOTIFY_SOCKET is \"") + path + "\", expected a path or @name");
  std::memcpy(address.sun_path, path, length);
  if (path[0] == '@') address.sun_path[0] = '\0';
  socket_ = wire::Descriptor(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + length);
  if (socket_ < 0 || ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), size) != 0)
    throw std::runtime_error(std::string("cannot reach NOTIFY_SOCKET ") + path + ": " + std::strerror(errno));
  const std::uint64_t watched = number_in_environment("WATCHDOG_PID");
  if (watched == 0 || watched == static_cast<std::uint64_t>(::getpid()))
    watchdog_us_ = number_in_environment("WATCHDOG_USEC");
}

// Does not wait: if the service manager does not read, the message is lost.
void ServiceManager::send(const std::string& message) const {
  if (socket_ >= 0) static_cast<void>(::send(socket_, message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT));
}

void ServiceManager::ready(const std::string& status) {
  send("READY=1\nSTATUS=" + status);
}
void ServiceManager::stopping() {
  stopping_ = true;
  send("STOPPING=1");
}

void ServiceManager::alive() {
  if (watchdog_us_ != 0) send("WATCHDOG=1");
}

void ServiceManager::recovering(int percent) {
  send("EXTEND_TIMEOUT_USEC=" + std::to_string(kCheckpointUs) + "\nSTATUS=recovering, " + std::to_string(percent) +
       " %");
}

void ServiceManager::checkpoint_begins() {
  if (stopping_) send("EXTEND_TIMEOUT_USEC=" + std::to_string(kCheckpointUs));
  if (watchdog_us_ != 0) send("WATCHDOG_USEC=" + std::to_string(kCheckpointUs));
}
void ServiceManager::checkpoint_ends() {
  if (watchdog_us_ != 0) send("WATCHDOG_USEC=" + std::to_string(watchdog_us_) + "\nWATCHDOG=1");
}

}  // namespace shearbus::server
