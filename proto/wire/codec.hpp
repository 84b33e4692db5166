// Encodes messages to frames and decodes frames to messages.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::wire {

// Whether the header of a message holds the sum of its payload. Only messages that stay in their process go without.
enum class PayloadSum { kGiven, kLeftOut };

// A message is a Request or a Reply.

// Returns the header frame of a message, in `memory` if its capacity suffices. The payload frame is
// message.batch.bytes(), sent only if the batch has columns.
// Throws Error{kLimit or kShape} for a message that no peer accepts, Error{kInvalidScene} for a scene that is not UTF-8.
template <typename Message>
std::string encode_header(const Message& message, std::string memory = {}, PayloadSum sum = PayloadSum::kGiven);

// Decodes a message. `frames` holds the header and, if the header declares it, the payload, whose bytes must outlive the
// message as described at Batch::over. Throws Error{kBadFraming, kMalformed, kVersion, kLimit, kChecksum, kShape or
// kUnsupported}; request_id, session_id and sequence are then set as far as they could be read, so that the refusal can
// be addressed. Numbers are not checked here: NaN or a negative dt is passed on as sent.
// `needed`: kLeftOut for messages of this process, and for those read from files with sums of their own, whose payload
// may go without its sum. Returns whether it does.
template <typename Message>
PayloadSum decode(std::span<const std::span<const std::byte>> frames, Message& message,
                  PayloadSum needed = PayloadSum::kGiven);

// Returns true if the header declares a payload frame; the payload may be empty.
bool declares_payload(std::span<const std::byte> header_frame);

// Of a header and a payload, which is empty where there is none, the frames that the message had.
inline std::span<const std::span<const std::byte>> frames_of(const std::array<std::span<const std::byte>, 2>& stored) {
  return std::span(stored).first(declares_payload(stored[0]) ? 2 : 1);
}

// Returns the XXH3-64 of the received bytes, by which a session distinguishes a repeated request from another request.
std::uint64_t hash_of(std::span<const std::span<const std::byte>> frames);

}  // namespace shearbus::wire
