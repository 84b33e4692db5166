// Encodes messages to frames and decodes frames to messages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::wire {

// The header frame of a message. The payload frame is message.batch.bytes(), sent only if the batch has columns. Throws
// Error{kLimit or kShape} for a message that no peer accepts, Error{kInvalidScene} for a scene that is not UTF-8.
std::string encode_header(const Request& request);
std::string encode_header(const Reply& reply);

// Decodes a message. `frames` holds the header and, if the header declares it, the payload, whose bytes must outlive
// the message as described at Batch::over. Throws Error{kBadFraming, kMalformed, kVersion, kLimit, kChecksum, kShape or
// kUnsupported}; request_id, session_id and sequence are then set as far as they could be read, so that the refusal can
// be addressed. Numbers are not checked here: NaN or a negative dt is passed on as sent.
void decode(std::span<const std::span<const std::byte>> frames, Request& message);
void decode(std::span<const std::span<const std::byte>> frames, Reply& message);

// Whether a payload frame follows this header; the payload may be empty.
bool declares_payload(std::span<const std::byte> header_frame);

// XXH3-64 of the received bytes, by which a session distinguishes a repeated request from another request.
std::uint64_t hash_of(std::span<const std::span<const std::byte>> frames);

}  // namespace shearbus::wire
