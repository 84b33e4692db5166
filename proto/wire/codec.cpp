#include "proto/wire/codec.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/stubs/logging.h>
#include <google/protobuf/unknown_field_set.h>
#include <xxhash.h>

#include <bit>
#include <memory>
#include <type_traits>
#include <utility>

#include "proto/wire/envelope_message.hpp"
#include "proto/wire/envelope_scan.hpp"
#include "proto/wire/with_message.hpp"
#include "shearbus/v1/envelope.pb.h"

static_assert(std::endian::native == std::endian::little, "columns are sent as they stand in memory");

namespace shearbus::wire {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using Frames = std::span<const std::span<const std::byte>>;

[[noreturn]] void refuse(Code code, std::string text, std::string remedy = {}, std::string field = {}) {
  throw Error({.code = code, .text = std::move(text), .remedy = std::move(remedy), .field = std::move(field)});
}

std::uint64_t xxh3(std::span<const std::byte> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

void put_payload(const Batch& batch, v1::Payload& to) {
  if (batch.columns().size() > kMaxColumns)
    refuse(Code::kShape, fmt::format("{} columns, at most {} fit a message", batch.columns().size(), kMaxColumns));
  if (batch.bytes().size() > kMaxPayloadBytes)
    refuse(Code::kLimit,
           fmt::format("payload of {} bytes, at most {} fit a message", batch.bytes().size(), kMaxPayloadBytes),
           "Send the nodes in several batches.");
  to.set_size_bytes(batch.bytes().size());
  to.set_xxh3(xxh3(batch.bytes()));
  for (const Column& column : batch.columns()) {
    v1::Column& message = *to.add_columns();
    message.set_field(static_cast<v1::Field>(column.field));
    message.set_component(column.component);
    message.set_element(static_cast<v1::Element>(column.element));
    message.set_offset_bytes(column.offset_bytes);
    message.set_count(column.count);
  }
}

template <typename Header, typename Value>
std::string encode(const Value& value) {
  thread_local std::unique_ptr<Header> reused;  // its strings and columns keep their memory
  std::string frame = with_message(reused, [&](Header& header) {
    to_message(value, header);
    if (!value.batch.columns().empty()) put_payload(value.batch, *header.mutable_payload());
    return header.SerializeAsString();
  });
  if (frame.size() > kMaxHeaderBytes)
    refuse(Code::kLimit, fmt::format("header of {} bytes, at most {} fit a message", frame.size(), kMaxHeaderBytes));
  return frame;
}

// ---- messages to values ----

// A scene, or a list of its faults, may be longer than other texts.
std::size_t text_limit(const FieldDescriptor& field) {
  const bool of_scene =
      &field == v1::OpenSession::descriptor()->FindFieldByNumber(v1::OpenSession::kSceneFieldNumber) ||
      &field == v1::SessionOpened::descriptor()->FindFieldByNumber(v1::SessionOpened::kEffectiveSceneFieldNumber) ||
      &field == v1::Status::descriptor()->FindFieldByNumber(v1::Status::kTextFieldNumber);
  return of_scene ? kMaxSceneBytes : kMaxTextBytes;
}

// What protobuf lets pass: fields nobody knows (`strict`), enum values nobody knows, text of any length.
void check_parts(const Message& message, const std::string& path, bool strict) {
  const auto& reflection = *message.GetReflection();
  const auto named = [&](const FieldDescriptor* field) {
    return path.empty() ? field->name() : path + "." + field->name();
  };
  if (strict && !reflection.GetUnknownFields(message).empty())
    refuse(Code::kMalformed,
           fmt::format("{} has a field number {} that protocol {}.{} does not know", path.empty() ? "the header" : path,
                       reflection.GetUnknownFields(message).field(0).number(), kProtocolMajor, kProtocolMinor),
           "A sender with newer fields says so in protocol_minor.", path);
  std::vector<const FieldDescriptor*> present;
  reflection.ListFields(message, &present);
  std::string scratch;
  for (const FieldDescriptor* field : present) {
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (!field->is_repeated()) check_parts(reflection.GetMessage(message, field), named(field), strict);
      for (int i = 0; field->is_repeated() && i < reflection.FieldSize(message, field); ++i)
        check_parts(reflection.GetRepeatedMessage(message, field, i), named(field), strict);
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM && !field->is_repeated()) {
      const int number = reflection.GetEnumValue(message, field);
      if (!field->enum_type()->FindValueByNumber(number))
        refuse(Code::kMalformed,
               fmt::format("{} = {} is no value of {}", named(field), number, field->enum_type()->name()), {},
               named(field));
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
      const int count = field->is_repeated() ? reflection.FieldSize(message, field) : 1;
      for (int i = 0; i < count; ++i) {
        const std::string& text = field->is_repeated()
                                      ? reflection.GetRepeatedStringReference(message, field, i, &scratch)
                                      : reflection.GetStringReference(message, field, &scratch);
        if (const std::size_t limit = text_limit(*field); text.size() > limit)
          refuse(Code::kLimit, fmt::format("{} has {} bytes, at most {} allowed", named(field), text.size(), limit), {},
                 named(field));
      }
    }
  }
}

template <typename Header>
bool may_carry_payload(const Header& header) {
  if constexpr (std::is_same_v<Header, v1::RequestHeader>)
    return header.has_open_session() || header.has_downscale() || header.has_register_nodes() ||
           header.has_retire_nodes() || header.has_offer_nodes();
  else
    return header.has_upscale() || header.has_session_resumed() || header.has_nodes_changed() ||
           header.has_rolled_back() || header.has_inspected();
}

// The payload frame, if there is one, is exactly what the header says of it.
template <typename Header>
Batch take_payload(const Header& header, Frames frames) {
  if (!header.has_payload()) {
    if (frames.size() == 2) refuse(Code::kBadFraming, "a payload frame arrived that the header does not declare");
    return {};
  }
  if (frames.size() == 1) refuse(Code::kBadFraming, "the header declares a payload, but no payload frame arrived");
  if (!may_carry_payload(header)) refuse(Code::kShape, "this kind of message carries no payload", {}, "payload");
  const v1::Payload& payload = header.payload();
  const std::span<const std::byte> bytes = frames[1];
  const auto count = static_cast<std::size_t>(payload.columns_size());
  if (count == 0 || count > kMaxColumns)
    refuse(Code::kShape, fmt::format("payload of {} columns, expected 1 to {}", count, kMaxColumns), {},
           "payload.columns");
  if (payload.size_bytes() != bytes.size())
    refuse(Code::kChecksum,
           fmt::format("the payload frame has {} bytes, its header says {}", bytes.size(), payload.size_bytes()),
           "Send the request again.", "payload.size_bytes");
  if (const std::uint64_t found = xxh3(bytes); found != payload.xxh3())
    refuse(Code::kChecksum,
           fmt::format("the payload frame has XXH3-64 {:016x}, its header says {:016x}", found, payload.xxh3()),
           "Send the request again.", "payload.xxh3");
  std::vector<Column> columns;
  columns.reserve(count);
  for (const v1::Column& column : payload.columns())
    columns.push_back({.field = static_cast<Field>(column.field()),
                       .component = column.component(),
                       .element = static_cast<Element>(column.element()),
                       .offset_bytes = column.offset_bytes(),
                       .count = column.count()});
  return Batch::over(std::move(columns), bytes);
}

void check_frames(Frames frames) {
  if (frames.empty() || frames.size() > kMaxFrames)
    refuse(Code::kBadFraming, fmt::format("{} frames, expected a header and at most one payload", frames.size()));
  if (frames[0].size() > kMaxHeaderBytes)
    refuse(Code::kLimit,
           fmt::format("header frame of {} bytes, at most {} allowed", frames[0].size(), kMaxHeaderBytes));
  if (frames.size() == 2 && frames[1].size() > kMaxPayloadBytes)
    refuse(Code::kLimit,
           fmt::format("payload frame of {} bytes, at most {} allowed", frames[1].size(), kMaxPayloadBytes),
           "Send the nodes in several batches.");
}

void check_envelope(const EnvelopeScan& scan) {
  if (!scan.magic)
    refuse(Code::kMalformed, "not a shearbus message: " + (scan.fault.empty() ? "it has no magic number" : scan.fault));
  if (*scan.magic != kMagic)
    refuse(Code::kMalformed,
           fmt::format("not a shearbus message: magic {:#010x}, expected {:#010x}", *scan.magic, kMagic), {}, "magic");
  if (scan.protocol_major != kProtocolMajor)
    refuse(Code::kVersion,
           fmt::format("message of protocol {}.{}, this side speaks {}.{}", scan.protocol_major, scan.protocol_minor,
                       kProtocolMajor, kProtocolMinor),
           "Use a client and a server of the same protocol major version.", "protocol_major");
  if (!scan.fault.empty()) refuse(Code::kMalformed, scan.fault);
}

template <typename Header, typename Value>
void decode_as(Frames frames, Value& message) {
  message = Value{};
  check_frames(frames);
  const EnvelopeScan scan = scan_envelope(frames[0]);
  message.protocol_major = scan.protocol_major;
  message.protocol_minor = scan.protocol_minor;
  message.request_id = scan.request_id;
  message.sequence = scan.sequence;
  message.epoch = scan.epoch;
  if (scan.session_id.size() == kSessionIdBytes) message.session_id = id_from(scan.session_id, "session_id");
  check_envelope(scan);
  id_from(scan.session_id, "session_id");
  if (scan.body != 0 && !Header::descriptor()->FindFieldByNumber(static_cast<int>(scan.body)))
    refuse(Code::kUnsupported,
           fmt::format("body {} is not one of protocol {}.{}", scan.body, kProtocolMajor, kProtocolMinor));

  thread_local std::unique_ptr<Header> reused;
  const google::protobuf::LogSilencer quiet;  // a stranger's bytes are no reason to write to stderr
  with_message(reused, [&](Header& header) {
    if (!header.ParseFromArray(frames[0].data(), static_cast<int>(frames[0].size())))
      refuse(Code::kMalformed, "the header frame does not parse");
    check_parts(header, "", scan.protocol_minor <= kProtocolMinor);
    from_message(header, message);
    message.batch = take_payload(header, frames);
  });
}

}  // namespace

std::string encode_header(const Request& request) {
  return encode<v1::RequestHeader>(request);
}
std::string encode_header(const Reply& reply) {
  return encode<v1::ReplyHeader>(reply);
}

void decode(Frames frames, Request& message) {
  decode_as<v1::RequestHeader>(frames, message);
}
void decode(Frames frames, Reply& message) {
  decode_as<v1::ReplyHeader>(frames, message);
}

bool declares_payload(std::span<const std::byte> header_frame) {
  return scan_envelope(header_frame).has_payload;
}

std::uint64_t hash_of(Frames frames) {
  std::uint64_t hash = 0;  // each frame's is the seed of the next: bytes cannot wander from frame to frame unseen
  for (const std::span<const std::byte> frame : frames) hash = XXH3_64bits_withSeed(frame.data(), frame.size(), hash);
  return hash;
}

}  // namespace shearbus::wire
