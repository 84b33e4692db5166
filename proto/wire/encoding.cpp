#include "proto/wire/encoding.hpp"

#include <algorithm>
#include <cstring>

namespace shearbus::wire {
static_assert(std::endian::native == std::endian::little, "fixed numbers are sent as they stand in memory");

void Encoder::grow(std::size_t bytes) {
  out_.resize(std::max(2 * out_.size(), end_ + bytes));
}

// Moves the content from `begin` on behind its length, which needs more than the one byte in front of it.
void Encoder::widen_length(std::size_t begin) {
  const std::size_t length = end_ - begin;
  room(kMaxVarintBytes);
  std::size_t more = 0;
  for (std::size_t rest = length; rest >= 0x80; rest >>= 7) ++more;
  std::memmove(out_.data() + begin + more, out_.data() + begin, length);
  end_ = begin - 1;
  put_varint(length);
  end_ += length;
}

bool Decoder::read_varint(std::uint64_t& value) {
  if (at_ < message_.size() && message_[at_] < std::byte{0x80}) {
    value = std::to_integer<std::uint64_t>(message_[at_++]);
    return true;
  }
  value = 0;
  for (std::size_t i = 0; i < kMaxVarintBytes && at_ < message_.size(); ++i) {
    const auto byte = std::to_integer<std::uint64_t>(message_[at_++]);
    value |= (byte & 0x7f) << (7 * i);
    if (byte < 0x80) return true;
  }
  return fail();
}

template <typename Number>
bool Decoder::read_fixed(std::uint64_t& value) {
  Number number;
  if (message_.size() - at_ < sizeof number) return fail();
  std::memcpy(&number, message_.data() + at_, sizeof number);
  at_ += sizeof number;
  value = number;
  return true;
}

bool Decoder::next_varint(std::uint64_t& value) {
  return at_ < message_.size() && !fault_ && read_varint(value);
}

bool Decoder::next_fixed64(std::uint64_t& value) {
  return at_ < message_.size() && !fault_ && read_fixed<std::uint64_t>(value);
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
      return read_fixed<std::uint64_t>(field.value);
    case WireType::kFixed32:
      return read_fixed<std::uint32_t>(field.value);
    case WireType::kLength:
      if (!read_varint(field.value) || field.value > message_.size() - at_) return fail();
      field.bytes = message_.subspan(at_, field.value);
      at_ += field.value;
      return true;
  }
  return fail();
}

}  // namespace shearbus::wire
