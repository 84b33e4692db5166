#include "proto/wire/codec.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <type_traits>
#include <utility>

#include "proto/wire/envelope_scan.hpp"
#include "proto/wire/field_codec.hpp"
#include "proto/wire/xxh3.hpp"

namespace shearbus::wire {
namespace {

// The lengths of lists in the rules of the schema (shearbus/v1/wire.proto).
static_assert(kMaxColumns == 32 && kMaxPairs + 1 == 257 && kMaxParameters == 24 && kMaxOffers == 256 &&
              kMaxNodesNamed == 16);

using Frames = std::span<const std::span<const std::byte>>;

// The declaration of the payload frame in a header. Columns is a vector to be read into, or a span to be written.
template <typename Columns = std::vector<Column>>
struct Payload {
  std::uint64_t size_bytes = 0;
  std::uint64_t xxh3 = 0;
  Columns columns;

  static void fields(auto&& v, auto& m) {
    v(1, "size_bytes", m.size_bytes);
    v(2, "xxh3", fixed(m.xxh3));
    v(3, "columns", at_most(kMaxColumns, m.columns));
  }
};

constexpr std::uint32_t kPayloadNumber = 8;

// Lists the fields that precede the payload in the header of a request and of a reply.
template <typename Message>
void envelope_fields(auto&& v, Message& m) {
  v(2, "protocol_major", m.protocol_major);
  v(3, "protocol_minor", m.protocol_minor);
  v(4, "request_id", fixed(m.request_id));
  v(5, "session_id", m.session_id);
  v(6, "sequence", m.sequence);
  v(7, "epoch", fixed(m.epoch));
}

[[noreturn]] void refuse(Code code, std::string text, std::string remedy = {}, std::string field = {}) {
  throw Error({.code = code, .text = std::move(text), .remedy = std::move(remedy), .field = std::move(field)});
}

// The sum of a payload that goes without: no field at all. A payload whose sum is 0 looks the same, and needs no check.
constexpr std::uint64_t kNoSum = 0;

Payload<std::span<const Column>> payload_of(const Batch& batch, PayloadSum sum) {
  if (batch.columns().size() > kMaxColumns)
    refuse(Code::kShape, fmt::format("{} columns, at most {} fit a message", batch.columns().size(), kMaxColumns));
  if (batch.bytes().size() > kMaxPayloadBytes)
    refuse(Code::kLimit,
           fmt::format("payload of {} bytes, at most {} fit a message", batch.bytes().size(), kMaxPayloadBytes),
           "Send the nodes in several batches.");
  return {.size_bytes = batch.bytes().size(),
          .xxh3 = sum == PayloadSum::kGiven ? xxh3(batch.bytes()) : kNoSum,
          .columns = batch.columns()};
}

// Returns the status with its list of node ids cut to kMaxNodesNamed, the most that the receiver accepts.
Status shortened(Status status) {
  status.node_ids.resize(std::min(status.node_ids.size(), kMaxNodesNamed));
  return status;
}

}  // namespace

template <typename Message>
std::string encode_header(const Message& message, std::string memory, PayloadSum sum) {
  Encoder out(std::move(memory));
  const FieldWriter write(out);
  out.fixed32(1, kMagic);
  envelope_fields(write, message);
  if (!message.batch.columns().empty()) write(kPayloadNumber, "payload", payload_of(message.batch, sum));
  if constexpr (std::is_same_v<Message, Reply>) {
    if (message.status.node_ids.size() <= kMaxNodesNamed)
      write(9, "status", message.status);
    else
      write(9, "status", shortened(message.status));
    write(10, "replayed", message.replayed);
  }
  const auto write_body = [&]<typename Body>(const Body& body) {
    if constexpr (HasRows<const Body>) write(Body::kBody.number, Body::kBody.name, body);
  };
  std::visit(write_body, message.body);
  std::string frame = out.take();
  if (frame.size() > kMaxHeaderBytes)
    refuse(Code::kLimit, fmt::format("header of {} bytes, at most {} fit a message", frame.size(), kMaxHeaderBytes));
  return frame;
}
template std::string encode_header(const Request&, std::string, PayloadSum);
template std::string encode_header(const Reply&, std::string, PayloadSum);

// ---- reading ----

namespace {

// Finds the type of a message's body by the number of the body. The first alternative of the variant means "no body".
template <typename Variant>
struct Bodies;
template <typename... Body>
struct Bodies<std::variant<std::monostate, Body...>> {
  // Calls use<Body>() for the body of this number; returns false if no body has the number.
  static bool find(std::uint32_t number, const auto& use) {
    return ((Body::kBody.number == number && (use.template operator()<Body>(), true)) || ...);
  }
};

// Checks that the payload frame is as the header declares it, and returns its columns. `sum`: whether the header must
// have its sum; receives whether it has.
Batch read_payload(Payload<>* payload, Frames frames, bool may_have_one, PayloadSum& sum) {
  if (!payload) {
    if (frames.size() == 2) refuse(Code::kBadFraming, "a payload frame arrived that the header does not declare");
    return {};
  }
  if (frames.size() == 1) refuse(Code::kBadFraming, "the header declares a payload, but no payload frame arrived");
  if (!may_have_one) refuse(Code::kShape, "this kind of message carries no payload", {}, "payload");
  const std::span<const std::byte> bytes = frames[1];
  if (payload->columns.empty()) refuse(Code::kShape, "the payload has no columns", {}, "payload.columns");
  if (payload->size_bytes != bytes.size())
    refuse(Code::kChecksum,
           fmt::format("the payload frame has {} bytes, its header says {}", bytes.size(), payload->size_bytes),
           "Send the request again.", "payload.size_bytes");
  if (payload->xxh3 != kNoSum) sum = PayloadSum::kGiven;
  if (sum == PayloadSum::kLeftOut) return Batch::over(std::move(payload->columns), bytes);
  if (const std::uint64_t found = xxh3(bytes); found != payload->xxh3)
    refuse(Code::kChecksum,
           fmt::format("the payload frame has XXH3-64 {:016x}, its header says {:016x}", found, payload->xxh3),
           "Send the request again.", "payload.xxh3");
  return Batch::over(std::move(payload->columns), bytes);
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

// Decodes a header after the scan of its envelope (envelope_scan.hpp) has found no fault.
template <typename Message>
void read_header(Frames frames, bool strict, Message& message, PayloadSum& sum) {
  const FieldPath header;
  const FieldPath payload_path{&header, "payload"};
  std::optional<Payload<>> payload;
  bool may_have_payload = false;
  bool has_status = false;
  Decoder in(frames[0]);
  EncodedField found;
  while (in.next(found)) {
    if (found.number < kPayloadNumber) continue;
    const bool is_body = Bodies<decltype(message.body)>::find(found.number, [&]<typename Body>() {
      may_have_payload = Body::kBody.payload;
      read_message(message.body.template emplace<Body>(), found.bytes, {&header, Body::kBody.name}, strict);
    });
    if (is_body) continue;
    if (found.number == kPayloadNumber) {
      read_message(payload.emplace(), found.bytes, payload_path, strict);
      continue;
    }
    if constexpr (std::is_same_v<Message, Reply>) {
      FieldReader reader(found, header, strict);
      reader(9, "status", message.status);
      reader(10, "replayed", message.replayed);
      has_status = has_status || found.number == 9;
      if (reader.known()) continue;
    }
    if (strict) refuse_unknown(found.number, header);
  }
  const bool has_body = message.body.index() != 0;
  if constexpr (std::is_same_v<Message, Reply>) {
    if (!has_status) refuse(Code::kMalformed, "the reply has no status", {}, "status");
    if (has_body != message.status.ok())
      refuse(Code::kMalformed,
             fmt::format("reply of status {} has {} body", name(message.status.code), has_body ? "a" : "no"), {},
             "body");
  } else if (!has_body) {
    refuse(Code::kMalformed, "the request has no body: nothing is asked", {}, "body");
  }
  message.batch = read_payload(payload ? &*payload : nullptr, frames, may_have_payload, sum);
}

}  // namespace

template <typename Message>
PayloadSum decode(Frames frames, Message& message, PayloadSum needed) {
  message = Message{};
  check_frames(frames);
  const EnvelopeScan scan = scan_envelope(frames[0]);
  message.protocol_major = scan.protocol_major;
  message.protocol_minor = scan.protocol_minor;
  message.request_id = scan.request_id;
  message.sequence = scan.sequence;
  message.epoch = scan.epoch;
  const FieldPath session_id{nullptr, "session_id"};
  if (scan.session_id.size() == kSessionIdBytes) message.session_id = read_id(scan.session_id, session_id);
  check_envelope(scan);
  read_id(scan.session_id, session_id);
  if (scan.body != 0 && !Bodies<decltype(message.body)>::find(scan.body, []<typename Body>() {}))
    refuse(Code::kUnsupported,
           fmt::format("body {} is not one of protocol {}.{}", scan.body, kProtocolMajor, kProtocolMinor));
  read_header(frames, scan.protocol_minor <= kProtocolMinor, message, needed);
  return message.batch.columns().empty() ? PayloadSum::kGiven : needed;
}
template PayloadSum decode(Frames, Request&, PayloadSum);
template PayloadSum decode(Frames, Reply&, PayloadSum);

bool declares_payload(std::span<const std::byte> header_frame) {
  return scan_envelope(header_frame).has_payload;
}

std::uint64_t hash_of(Frames frames) {
  // The hash of a frame is the seed of the next, so that moving bytes between frames changes the result.
  std::uint64_t hash = 0;
  for (const std::span<const std::byte> frame : frames) hash = xxh3(frame, hash);
  return hash;
}

}  // namespace shearbus::wire
