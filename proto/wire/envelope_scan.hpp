// A first look at a header frame, before protobuf parses it: the fixed part of the envelope, read without allocating.
// Protobuf alone would take an empty buffer for a message of defaults and two messages for one (repeated fields are
// merged).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace shearbus::wire {

struct EnvelopeScan {
  std::optional<std::uint32_t> magic;
  std::uint32_t protocol_major = 0;
  std::uint32_t protocol_minor = 0;
  std::uint64_t request_id = 0;
  std::span<const std::byte> session_id;
  std::uint64_t sequence = 0;
  std::uint64_t epoch = 0;
  bool has_payload = false;  // declares one
  std::uint32_t body = 0;    // field number of the message in the oneof, 16 to 31; 0: none
  std::string fault;  // empty: the top level is sound. What was read before the fault stands in the fields above.
};

EnvelopeScan scan_envelope(std::span<const std::byte> header);

}  // namespace shearbus::wire
