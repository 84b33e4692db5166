// Requests and replies as values to header messages and back: the one place that knows both. Payload frames are
// codec.cpp's.
#pragma once

#include <cstddef>
#include <span>

#include "proto/wire/messages.hpp"

namespace shearbus::v1 {
class RequestHeader;
class ReplyHeader;
}  // namespace shearbus::v1

namespace shearbus::wire {

// Everything but the payload. Texts are cut to their limit and to valid UTF-8, but a scene that does not fit is refused.
void to_message(const Request& request, v1::RequestHeader& message);
void to_message(const Reply& reply, v1::ReplyHeader& message);

// Body and status. Throws Error{kMalformed, kShape or kLimit} where a part is missing or has no value.
void from_message(const v1::RequestHeader& message, Request& request);
void from_message(const v1::ReplyHeader& message, Reply& reply);

// 16 bytes or none; Error{kMalformed} naming `field` otherwise.
SessionId id_from(std::span<const std::byte> bytes, const char* field);

}  // namespace shearbus::wire
