// Encodes messages to frames and decodes frames to messages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::wire {

// Whether the header of a message holds the sum of its payload. Only messages that stay in their process go without.
enum class PayloadSum { kGiven, kLeftOut };

// Return the header frame of a message, in `memory` if its capacity suffices. The payload frame is
// message.batch.bytes(), sent only if the batch has columns.
// Throw Error{kLimit or kShape} for a message that no peer accepts, Error{kInvalidScene} for a scene that is not UTF-8.
std::string encode_header(const Request& request, std::string memory = {}, PayloadSum sum = PayloadSum::kGiven);
std::string encode_header(const Reply& reply, std::string memory = {}, PayloadSum sum = PayloadSum::kGiven);

// Decode a message. `frames` holds the header and, if the header declares it, the payload, whose bytes must outlive the
// message as described at Batch::over. Throw Error{kBadFraming, kMalformed, kVersion, kLimit, kChecksum, kShape or
// kUnsupported}; request_id, session_id and sequence are then set as far as they could be read, so that the refusal can
// be addressed. Numbers are not checked here: NaN or a negative dt is passed on as sent.
void decode(std::span<const std::span<const std::byte>> frames, Request& message);
void decode(std::span<const std::span<const std::byte>> frames, Reply& message);

// The same for messages of this process, and for those read from files with sums of their own: their payload may go
// without its sum. Return whether it does.
PayloadSum decode_trusted(std::span<const std::span<const std::byte>> frames, Request& message);
PayloadSum decode_trusted(std::span<const std::span<const std::byte>> frames, Reply& message);

// Returns true if the header declares a payload frame; the payload may be empty.
bool declares_payload(std::span<const std::byte> header_frame);

// Returns the XXH3-64 of the received bytes, by which a session distinguishes a repeated request from another request.
std::uint64_t hash_of(std::span<const std::span<const std::byte>> frames);

}  // namespace shearbus::wire
