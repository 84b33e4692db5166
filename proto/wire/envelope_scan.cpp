#include "proto/wire/envelope_scan.hpp"

#include <fmt/format.h>

#include <array>

#include "proto/wire/encoding.hpp"

namespace shearbus::wire {
namespace {

// Field numbers of RequestHeader and ReplyHeader, which have the same fields up to number 8.
constexpr std::uint32_t kFirstBody = 16;
constexpr std::uint32_t kLastOnce = 47;  // no field up to this number may occur twice

// Returns the wire type of a field of the envelope; none for an unknown number, which may have any type.
std::optional<WireType> wire_type_of(std::uint32_t number) {
  using enum WireType;
  constexpr std::array kTypes = {kFixed32, kVarint,  kVarint, kFixed64, kLength,
                                 kVarint,  kFixed64, kLength, kLength,  kVarint};
  if (number >= 1 && number <= kTypes.size()) return kTypes[number - 1];
  return number >= kFirstBody && number <= kLastOnce ? std::optional(kLength) : std::nullopt;
}

void keep(const EncodedField& field, EnvelopeScan& scan) {
  const auto number = [&]<typename Number>(std::uint32_t of, Number& kept) {
    if (field.number == of) kept = static_cast<Number>(field.value);
  };
  if (field.number == 1) scan.magic = static_cast<std::uint32_t>(field.value);
  number(2, scan.protocol_major);
  number(3, scan.protocol_minor);
  number(4, scan.request_id);
  if (field.number == 5) scan.session_id = field.bytes;
  number(6, scan.sequence);
  number(7, scan.epoch);
  if (field.number == 8) scan.has_payload = true;
}

// Returns the fault of a field, given the fields before it; empty if the field is sound.
std::string fault_of(const EncodedField& field, std::size_t at, std::uint64_t seen, std::uint32_t body) {
  const auto expected = wire_type_of(field.number);
  if (expected && *expected != field.type)
    return fmt::format("byte {} of the header frame does not start a field of the envelope", at);
  if (field.number > kLastOnce) return {};
  if (seen >> field.number & 1U)
    return fmt::format("field {} stands twice in the header frame (two messages in one frame?)", field.number);
  if (field.number >= kFirstBody && body != 0)
    return fmt::format("the header frame holds two bodies, fields {} and {}", body, field.number);
  return {};
}

}  // namespace

EnvelopeScan scan_envelope(std::span<const std::byte> header) {
  EnvelopeScan scan;
  if (header.empty()) scan.fault = "the header frame is empty";
  Decoder in(header);
  EncodedField field;
  std::uint64_t seen = 0;  // bit n: field n was found
  for (std::size_t at = 0; in.next(field); at = in.position()) {
    scan.fault = fault_of(field, at, seen, scan.body);
    if (!scan.fault.empty()) return scan;
    if (field.number <= kLastOnce) seen |= std::uint64_t{1} << field.number;
    if (field.number >= kFirstBody && field.number <= kLastOnce) scan.body = field.number;
    keep(field, scan);
  }
  if (in.fault())
    scan.fault = fmt::format("the header frame is cut short, or holds no field, before byte {}", in.position());
  return scan;
}

}  // namespace shearbus::wire
