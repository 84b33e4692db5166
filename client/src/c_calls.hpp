// Internal to the C interface: what each of its calls does before its own work and after it, whichever the verb. It checks
// the caller's structs, takes the session for this call, and turns what is thrown into a code and a status.
#pragma once

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "client/include/shearbus/shearbus.h"
#include "client/src/client.hpp"
#include "proto/wire/host_process.hpp"

namespace shearbus {

[[noreturn]] inline void refuse(Code code, std::string text, std::string remedy, std::string field = {}) {
  throw Error({.code = code, .text = std::move(text), .remedy = std::move(remedy), .field = std::move(field)});
}

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

// The process and the thread that may use a session. A session has one at a time.
class Holder {
 public:
  // Begins a call. Throws Error: kOtherProcess in a process other than that of the session, where the threads of libzmq
  // do not exist, and kInUse while another call of the session is under way.
  void enter() {
    if (!is_of_this_process())
      refuse(Code::kOtherProcess,
             fmt::format("this session belongs to process {}, of which this process, {}, is a fork", process_,
                         wire::this_process()),
             "Open one in the child, or use the session in the process that opened it.");
    if (busy_.exchange(true, std::memory_order_acquire))
      refuse(Code::kInUse, "another thread, or the log callback, is inside a call on this session",
             "Make one call at a time on a session: guard it with a lock, or open a session per thread.");
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

// ---- structs of the caller ----

constexpr std::size_t kLargestStruct = 4096;  // [bytes]; a larger `size` in a caller's struct is uninitialised

template <typename Struct>
bool has_sound_size(const Struct& given) {
  return given.size >= sizeof(Struct) && given.size <= kLargestStruct;
}

// The members of a caller's struct that this library knows. A caller that was compiled with a later header may have
// more members; it is refused if one of those is not zero.
template <typename Struct>
Struct known(const Struct* given, const char* type) {
  if (given == nullptr)
    refuse(Code::kInvalidValue, fmt::format("the {} is NULL", type), "Give a struct that starts from its _INIT.");
  if (!has_sound_size(*given))
    refuse(Code::kInvalidValue,
           fmt::format("{}.size is {}, expected {} to {}", type, given->size, sizeof(Struct), kLargestStruct),
           "Start the struct from its _INIT, which sets the size.");
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  if (std::any_of(bytes + sizeof(Struct), bytes + given->size, [](unsigned char byte) { return byte != 0; }))
    refuse(Code::kUnsupported,
           fmt::format("{} has {} bytes, and this library {} knows the first {}", type, given->size, shearbus_version(),
                       sizeof(Struct)),
           "Use a library at least as new as the header that the host was compiled with.");
  return *given;
}

// Copies the values to the caller's struct, whose size has_sound_size() has checked, and keeps its `size`.
template <typename Struct>
void give(Struct values, Struct* to) {
  values.size = to->size;
  *to = values;
}

inline std::string_view text_or(const char* text, std::string_view otherwise = {}) {
  return text == nullptr ? otherwise : std::string_view(text);
}

template <typename T>
std::span<const T> values_of(const T* values, std::size_t n, const char* name) {
  if (n > 0 && values == nullptr)
    refuse(Code::kInvalidValue, fmt::format("{} is NULL for {} nodes", name, n), "Give one value per node.", name);
  return {values, n};
}

// ---- status ----

int report(shearbus_status* to, int code, std::string_view text = {}, std::string_view remedy = {},
           std::string_view field = {}, std::span<const std::uint64_t> nodes = {}) noexcept;
int report_caught(shearbus_status* to) noexcept;  // the exception that is being handled

// Runs the body of a function of the interface, and turns what it throws into a code and a status.
template <typename Body>
int guarded(shearbus_status* status, const Body& body) noexcept {
  if (status != nullptr && !has_sound_size(*status))
    return report(nullptr, SHEARBUS_INVALID_VALUE, "the size of shearbus_status is wrong: start it from its _INIT");
  const Entry entry;
  try {
    body();
    return report(status, SHEARBUS_OK);
  } catch (...) {
    return report_caught(status);
  }
}

}  // namespace shearbus
