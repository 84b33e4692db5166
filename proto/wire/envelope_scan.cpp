#include "proto/wire/envelope_scan.hpp"

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>

namespace shearbus::wire {
namespace {

using google::protobuf::io::CodedInputStream;

enum WireType : std::uint32_t { kVarint = 0, kFixed64 = 1, kLength = 2, kFixed32 = 5 };

// Field numbers of RequestHeader and ReplyHeader, which are the same up to 8.
constexpr std::uint32_t kFirstBody = 16;
constexpr std::uint32_t kLastOnce = 47;  // no field up to here is repeated

// Wire type a field of the envelope must have; any for a number this version does not know.
std::optional<std::uint32_t> wire_type_of(std::uint32_t number) {
  switch (number) {
    case 1:
      return kFixed32;
    case 2:
    case 3:
    case 6:
    case 10:
      return kVarint;
    case 4:
    case 7:
      return kFixed64;
    case 5:
    case 8:
    case 9:
      return kLength;
    default:
      return number >= kFirstBody && number <= kLastOnce ? std::optional<std::uint32_t>(kLength) : std::nullopt;
  }
}

bool read_length(CodedInputStream& in, std::span<const std::byte> header, std::span<const std::byte>& bytes) {
  std::uint32_t size = 0;
  if (!in.ReadVarint32(&size)) return false;
  const auto at = static_cast<std::size_t>(in.CurrentPosition());
  if (size > header.size() - at || !in.Skip(static_cast<int>(size))) return false;
  bytes = header.subspan(at, size);
  return true;
}

bool read_field(CodedInputStream& in, std::span<const std::byte> header, std::uint32_t number, std::uint32_t type,
                EnvelopeScan& scan) {
  std::uint32_t small = 0;
  std::uint64_t large = 0;
  std::span<const std::byte> bytes;
  switch (type) {
    case kVarint:
      if (!in.ReadVarint64(&large)) return false;
      if (number == 2) scan.protocol_major = static_cast<std::uint32_t>(large);
      if (number == 3) scan.protocol_minor = static_cast<std::uint32_t>(large);
      if (number == 6) scan.sequence = large;
      return true;
    case kFixed64:
      if (!in.ReadLittleEndian64(&large)) return false;
      if (number == 4) scan.request_id = large;
      if (number == 7) scan.epoch = large;
      return true;
    case kFixed32:
      if (!in.ReadLittleEndian32(&small)) return false;
      if (number == 1) scan.magic = small;
      return true;
    case kLength:
      if (!read_length(in, header, bytes)) return false;
      if (number == 5) scan.session_id = bytes;
      if (number == 8) scan.has_payload = true;
      return true;
    default:
      return false;  // groups, and wire types that do not exist
  }
}

}  // namespace

EnvelopeScan scan_envelope(std::span<const std::byte> header) {
  EnvelopeScan scan;
  if (header.empty()) {
    scan.fault = "the header frame is empty";
    return scan;
  }
  CodedInputStream in(reinterpret_cast<const std::uint8_t*>(header.data()), static_cast<int>(header.size()));
  std::uint64_t seen = 0;
  while (static_cast<std::size_t>(in.CurrentPosition()) < header.size()) {
    const int at = in.CurrentPosition();
    const std::uint32_t tag = in.ReadTag();
    const std::uint32_t number = tag >> 3;
    const std::uint32_t type = tag & 7;
    const auto expected = wire_type_of(number);
    if (number == 0 || (expected && *expected != type)) {
      scan.fault = fmt::format("byte {} of the header frame does not start a field of the envelope", at);
      return scan;
    }
    if (number <= kLastOnce) {
      if (seen >> number & 1U) {
        scan.fault = fmt::format("field {} stands twice in the header frame (two messages in one frame?)", number);
        return scan;
      }
      seen |= std::uint64_t{1} << number;
    }
    if (!read_field(in, header, number, type, scan)) {
      scan.fault = fmt::format("field {} at byte {} runs past the end of the header frame", number, at);
      return scan;
    }
    if (number >= kFirstBody && number <= kLastOnce) {
      if (scan.body != 0) {
        scan.fault = fmt::format("the header frame holds two bodies, fields {} and {}", scan.body, number);
        return scan;
      }
      scan.body = number;
    }
  }
  return scan;
}

}  // namespace shearbus::wire
