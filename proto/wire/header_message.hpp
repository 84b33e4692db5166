// What request_message.cpp and reply_message.cpp share.
#pragma once

#include <fmt/format.h>

#include <span>
#include <string>
#include <utility>

#include "proto/wire/envelope_message.hpp"
#include "proto/wire/text.hpp"
#include "shearbus/v1/envelope.pb.h"

namespace shearbus::wire {

[[noreturn]] inline void refuse(Code code, std::string text, std::string field) {
  throw Error({.code = code, .text = std::move(text), .field = std::move(field)});
}

// Nothing of an id of zeros.
inline std::string id_bytes(const SessionId& id) {
  return id == SessionId{} ? std::string() : std::string(id.begin(), id.end());
}

inline std::span<const std::byte> bytes_of(const std::string& text) {
  return std::as_bytes(std::span(text));
}

// A scene is never cut or mended: what does not fit a message is refused.
inline const std::string& scene_text(const std::string& text, const char* field) {
  if (text.size() > kMaxSceneBytes)
    refuse(Code::kLimit, fmt::format("the scene has {} bytes, at most {} allowed", text.size(), kMaxSceneBytes), field);
  if (!is_utf8(text)) refuse(Code::kInvalidScene, "the scene is not UTF-8 text", field);
  return text;
}

// All but the body, of a request or a reply.
template <typename Value, typename Header>
void put_header(const Value& value, Header& header) {
  header.Clear();
  header.set_magic(kMagic);
  header.set_protocol_major(value.protocol_major);
  header.set_protocol_minor(value.protocol_minor);
  header.set_request_id(value.request_id);
  header.set_session_id(id_bytes(value.session_id));
  header.set_sequence(value.sequence);
  header.set_epoch(value.epoch);
}

}  // namespace shearbus::wire
