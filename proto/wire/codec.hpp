// Messages to frames and back. Protobuf is seen by .cpp files of this room only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::wire {

// The header frame of a message; the payload frame is message.batch.bytes(), sent only where the batch has columns.
// Throws Error{kLimit} for what no peer would take, Error{kInvalidScene} for a scene that cannot be said.
std::string encode_header(const Request& request);
std::string encode_header(const Reply& reply);

// Frames to a message. `frames` holds the header and, where the header declares one, the payload; see Batch::over for
// how long the payload's bytes must live. Throws Error{kBadFraming, kMalformed, kVersion, kLimit, kChecksum, kShape or
// kUnsupported}; what could be read of request_id, session_id and sequence before the fault is left in `message`, so
// that an answer finds its way. Numbers are not judged here: NaN, a negative dt and the like arrive as they were sent.
void decode(std::span<const std::span<const std::byte>> frames, Request& message);
void decode(std::span<const std::span<const std::byte>> frames, Reply& message);

// Whether a payload frame, though it may be empty, belongs to this header.
bool declares_payload(std::span<const std::byte> header_frame);

// XXH3-64 of bytes as received: what a session keeps to know a repeated request from a different one.
std::uint64_t hash_of(std::span<const std::span<const std::byte>> frames);

}  // namespace shearbus::wire
