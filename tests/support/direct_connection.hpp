// What a connection of the client library receives from a service in the same thread.
#pragma once

#include <memory>
#include <span>
#include <utility>

#include "client/src/connection.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::support {

// Returns the answer as a client gets it. Throws a refusal.
inline Received received(Answer answered, wire::PayloadSum needed = wire::PayloadSum::kGiven) {
  auto answer = std::make_shared<Answer>(std::move(answered));
  Received received{.payload_frame = answer, .reply = {}};
  const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(answer->frames.header)),
                                                answer->frames.payload};
  wire::decode(std::span(frames, answer->frames.has_payload ? 2 : 1), received.reply, needed);
  if (!received.reply.status.ok()) throw Error(received.reply.status);
  return received;
}

}  // namespace shearbus::support
