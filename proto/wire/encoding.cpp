#include "proto/wire/encoding.hpp"

#include <cstring>

namespace shearbus::wire {
static_assert(std::endian::native == std::endian::little, "fixed numbers are sent as they stand in memory");

namespace {

constexpr std::size_t kMaxVarintBytes = 10;

// A varint: seven bits in each byte, the lowest bits first; the top bit is set if another byte follows.
struct VarintText {
  explicit VarintText(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes[size++] = static_cast<char>(value | 0x80);
    bytes[size++] = static_cast<char>(value);
  }
  std::string_view text() const { return {bytes, size}; }

  char bytes[kMaxVarintBytes];
  std::size_t size = 0;
};

}  // namespace

void Encoder::raw_varint(std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) out_.push_back(static_cast<char>(value | 0x80));
  out_.push_back(static_cast<char>(value));
}

void Encoder::raw_fixed64(std::uint64_t value) {
  out_.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void Encoder::tag(std::uint32_t number, WireType type) {
  raw_varint(std::uint64_t{number} << 3 | static_cast<std::uint32_t>(type));
}

void Encoder::varint(std::uint32_t number, std::uint64_t value) {
  tag(number, WireType::kVarint);
  raw_varint(value);
}

void Encoder::fixed32(std::uint32_t number, std::uint32_t value) {
  tag(number, WireType::kFixed32);
  out_.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void Encoder::fixed64(std::uint32_t number, std::uint64_t value) {
  tag(number, WireType::kFixed64);
  raw_fixed64(value);
}

void Encoder::bytes(std::uint32_t number, std::string_view value) {
  tag(number, WireType::kLength);
  raw_varint(value.size());
  out_ += value;
}

void Encoder::insert_length(std::size_t begin) {
  out_.insert(begin, VarintText(out_.size() - begin).text());
}

bool Decoder::read_varint(std::uint64_t& value) {
  value = 0;
  for (std::size_t i = 0; i < kMaxVarintBytes && at_ < message_.size(); ++i) {
    const auto byte = std::to_integer<std::uint64_t>(message_[at_++]);
    value |= (byte & 0x7f) << (7 * i);
    if (byte < 0x80) return true;
  }
  return fail();
}

bool Decoder::read_fixed(std::size_t size, std::uint64_t& value) {
  if (message_.size() - at_ < size) return fail();
  value = 0;
  std::memcpy(&value, message_.data() + at_, size);
  at_ += size;
  return true;
}

bool Decoder::next_varint(std::uint64_t& value) {
  return at_ < message_.size() && !fault_ && read_varint(value);
}

bool Decoder::next_fixed64(std::uint64_t& value) {
  return at_ < message_.size() && !fault_ && read_fixed(sizeof value, value);
}

bool Decoder::next(EncodedField& field) {
  std::uint64_t tag = 0;
  if (!next_varint(tag)) return false;
  if (tag > 0xffffffffU || tag >> 3 == 0) return fail();
  field = {.number = static_cast<std::uint32_t>(tag >> 3), .type = static_cast<WireType>(tag & 7)};
  switch (field.type) {
    case WireType::kVarint:
      return read_varint(field.value);
    case WireType::kFixed64:
      return read_fixed(8, field.value);
    case WireType::kFixed32:
      return read_fixed(4, field.value);
    case WireType::kLength:
      if (!read_varint(field.value) || field.value > message_.size() - at_) return fail();
      field.bytes = message_.subspan(at_, field.value);
      at_ += field.value;
      return true;
  }
  return fail();
}

}  // namespace shearbus::wire
