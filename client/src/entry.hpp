// Internal to the C interface: what each of its calls does before its own work and after it, whichever the verb.
#pragma once

#include <fmt/format.h>
#include <pthread.h>

#include <atomic>
#include <string>
#include <utility>

#include "client/include/shearbus/shearbus.h"
#include "proto/wire/host_process.hpp"

namespace shearbus {

// Nothing of the host's thread reaches into a call: neither its floating-point environment, which is as before
// afterwards, nor its cancellation, which is delayed. A thread cancelled inside a call would end the process, because
// the unwinding of its stack cannot pass a noexcept function.
class Entry {
 public:
  Entry() noexcept { pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &before_); }
  Entry(const Entry&) = delete;
  Entry& operator=(const Entry&) = delete;
  ~Entry() { pthread_setcancelstate(before_, nullptr); }

 private:
  int before_ = PTHREAD_CANCEL_ENABLE;
  wire::DefaultFloatingPoint floating_point_;
};

// A call that cannot be made where it was made: a fault of codes that the protocol does not have.
struct WrongCaller {
  int code;
  std::string text;
  const char* remedy;
};

// The process and the thread that may use a session. A session has one at a time.
class Holder {
 public:
  // Begins a call. Throws WrongCaller in a process other than that of the session, where the threads of libzmq do not
  // exist, and while another call of the session is under way.
  void enter() {
    if (!is_of_this_process())
      throw WrongCaller{SHEARBUS_OTHER_PROCESS,
                        fmt::format("this session belongs to process {}, of which this process, {}, is a fork",
                                    process_, wire::this_process()),
                        "Open one in the child, or use the session in the process that opened it."};
    if (busy_.exchange(true, std::memory_order_acquire))
      throw WrongCaller{SHEARBUS_IN_USE, "another thread, or the log callback, is inside a call on this session",
                        "Make one call at a time on a session: guard it with a lock, or open a session per thread."};
  }
  void leave() noexcept { busy_.store(false, std::memory_order_release); }

  bool is_of_this_process() const noexcept { return wire::this_process() == process_; }

 private:
  pid_t process_ = wire::this_process();
  std::atomic<bool> busy_{false};
};

// A call of a session, for the duration of a scope.
class Call {
 public:
  explicit Call(Holder* holder) { enter(holder); }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;
  ~Call() {
    if (holder_ != nullptr) holder_->leave();
  }
  void enter(Holder* holder) {  // the session's, if there is one
    if (holder != nullptr) holder->enter();
    holder_ = holder;
  }
  void forget() noexcept { holder_ = nullptr; }  // the session is about to be freed

 private:
  Holder* holder_ = nullptr;
};

}  // namespace shearbus
