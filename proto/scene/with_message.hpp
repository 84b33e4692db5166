// Functions that use protobuf messages and survive a lack of memory. Protobuf is not exception-safe: after a failed
// allocation a message holds invalid pointers, which its destructor would follow. Such a message is leaked instead, and
// the server survives.
#pragma once

#include <memory>
#include <new>

namespace shearbus::wire {

// Calls use(*kept); if `kept` is empty, makes the message first. The message keeps its memory for the next call. If
// memory runs out, the message is leaked, `kept` is empty again, and std::bad_alloc is thrown.
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

// Calls use(message) with a message that exists only for this call.
template <typename Message, typename Use>
decltype(auto) with_message(const Use& use) {
  std::unique_ptr<Message> message;
  return with_message(message, use);
}

}  // namespace shearbus::wire
