// What a library needs that runs in the process of a host: a floating-point environment of its own, threads of its own,
// calls that the host's signals interrupt, and a look at the limits of the process before libzmq meets them.
#pragma once

#include <sys/types.h>
#include <cerrno>
#include <cfenv>
#include <csignal>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>

#include "proto/wire/handle.hpp"

namespace shearbus::wire {

// Gives this thread the default floating-point environment: no traps, round to nearest, subnormal numbers kept. The
// destructor restores the environment of before, with its flags.
class DefaultFloatingPoint {
 public:
  DefaultFloatingPoint() noexcept;
  DefaultFloatingPoint(const DefaultFloatingPoint&) = delete;
  DefaultFloatingPoint& operator=(const DefaultFloatingPoint&) = delete;
  ~DefaultFloatingPoint();

 private:
  bool changed_ = true;
  unsigned control_ = 0;
  std::fenv_t before_{};
};

// The number of this process, also in one that was made by fork() or clone(). Costs no system call.
pid_t this_process() noexcept;

// Blocks all signals for this thread, and for threads that it starts, so that they go to the host's other threads.
class SignalsBlocked {
 public:
  SignalsBlocked() noexcept;
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;
  ~SignalsBlocked();

 private:
  sigset_t before_{};
};

// Starts a thread that inherits nothing of the thread that starts it: it has the default floating-point environment and
// takes no signals. All threads of the libraries are started here. Throws std::system_error, which names the limit, if
// no thread can be made.
std::thread own_thread(std::function<void()> run);

// Makes a system call, or a call of libzmq, again while signals interrupt it. Such a call fails with a negative number
// or a null pointer.
template <typename Call>
auto uninterrupted(const Call& call) {
  for (;;) {
    const auto result = call();
    bool failed = false;
    if constexpr (std::is_pointer_v<decltype(call())>)
      failed = result == nullptr;
    else
      failed = result < 0;
    if (!failed || errno != EINTR) return result;
  }
}

// A file that is readable once it is set: it ends the poll() of another thread.
class Event {
 public:
  // Throws std::runtime_error, which begins with `fault` and names the limit, if there is no file to be had.
  explicit Event(const char* fault);

  int file() const noexcept { return file_; }
  void set() const noexcept;
  void clear() const noexcept;

 private:
  Descriptor file_;
};

inline constexpr unsigned kMaxThreads = 4096;           // of a server, that solve layers
inline constexpr std::size_t kLongestSocketPath = 107;  // [bytes] of an ipc socket in the file system

// True if a process listens at the path of a socket, even if it does not answer.
bool is_served(std::string_view path);

// libzmq ends the process if it cannot make the threads and the files of a context, or gets no memory. Called before the first socket of
// each context: throws std::runtime_error, which names the limit, if there is no room for them.
void check_room_for_sockets();

// The limit that keeps this process from opening a file: "the process may have 1024 files open (ulimit -n)".
std::string limit_of_files();

}  // namespace shearbus::wire
