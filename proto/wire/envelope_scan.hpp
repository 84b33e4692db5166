// Scans the envelope of a header frame before its body is decoded, without allocating. The rules of protobuf alone
// would accept an empty buffer as a message of defaults, and two concatenated messages as one message.
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
  bool has_payload = false;  // true if the header declares a payload frame
  std::uint32_t body = 0;    // field number of the body, 16 to 47; 0: no body
  std::string fault;         // empty if the envelope is sound; otherwise the other members hold what precedes the fault
};

EnvelopeScan scan_envelope(std::span<const std::byte> header);

}  // namespace shearbus::wire
