// Protobuf messages where memory may run out. Protobuf is not exception-safe: a message inside of which an allocation
// failed holds pointers to what was never made, and its destructor follows them. Such a one is abandoned: some memory
// is lost, and the server lives.
#pragma once

#include <memory>
#include <new>

namespace shearbus::wire {

// use(*kept), made where there is none; it keeps its memory for the next use.
template <typename Message, typename Use>
decltype(auto) with_message(std::unique_ptr<Message>& kept, const Use& use) {
  if (!kept) kept = std::make_unique<Message>();
  try {
    return use(*kept);
  } catch (const std::bad_alloc&) {
    static_cast<void>(kept.release());
    throw;
  }
}

// use(message) with one of its own.
template <typename Message, typename Use>
decltype(auto) with_message(const Use& use) {
  std::unique_ptr<Message> message;
  return with_message(message, use);
}

}  // namespace shearbus::wire
