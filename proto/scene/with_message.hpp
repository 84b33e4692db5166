// Functions that use protobuf messages and survive a lack of memory. Protobuf is not exception-safe: after a failed
// allocation a message holds invalid pointers, which its destructor would follow. Such a message is leaked instead, and
// the server survives.
#pragma once

#include <memory>
#include <new>

namespace shearbus::wire {

// Calls use(message) with a message that exists only for this call. If memory runs out, the message is leaked, and
// std::bad_alloc is thrown.
template <typename Message, typename Use>
decltype(auto) with_message(const Use& use) {
  auto message = std::make_unique<Message>();
  try {
    return use(*message);
  } catch (const std::bad_alloc&) {
    static_cast<void>(message.release());
    throw;
  }
}

}  // namespace shearbus::wire
