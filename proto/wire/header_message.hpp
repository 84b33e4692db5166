// What request_message.cpp and reply_message.cpp share.
#pragma once

#include <span>
#include <string>
#include <utility>

#include "proto/wire/envelope_message.hpp"
#include "proto/wire/scene_message.hpp"
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

inline void put_scene(const Scene& scene, v1::Scene& message) {
  to_message(scene, message);
  message.clear_hydro();  // the guest's own business
}

inline Scene take_scene(const v1::Scene& message) {
  Scene scene = from_message(message);
  scene.hydro.reset();
  return scene;
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
