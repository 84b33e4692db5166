// The encoding of protocol buffers, as far as headers need it: tags, varints, fixed numbers, lengths. Each message
// lists its fields (field_rows.hpp); only this file knows their encoding.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <utility>

namespace shearbus::wire {

enum class WireType : std::uint32_t { kVarint = 0, kFixed64 = 1, kLength = 2, kFixed32 = 5 };

inline constexpr std::size_t kMaxVarintBytes = 10;  // of 64 bits, seven in each

// Appends fields to a message.
class Encoder {
 public:
  // `memory` is overwritten; its capacity is used.
  explicit Encoder(std::string memory = {}) : out_(std::move(memory)) { out_.resize(kUsualBytes); }

  void varint(std::uint32_t number, std::uint64_t value) {
    room(2 * kMaxVarintBytes);
    tag(number, WireType::kVarint);
    put_varint(value);
  }
  void fixed32(std::uint32_t number, std::uint32_t value) {
    room(kMaxVarintBytes + sizeof value);
    tag(number, WireType::kFixed32);
    put(&value, sizeof value);
  }
  void fixed64(std::uint32_t number, std::uint64_t value) {
    room(kMaxVarintBytes + sizeof value);
    tag(number, WireType::kFixed64);
    put(&value, sizeof value);
  }
  void bytes(std::uint32_t number, std::string_view value) {
    room(2 * kMaxVarintBytes + value.size());
    tag(number, WireType::kLength);
    put_varint(value.size());
    put(value.data(), value.size());
  }
  // Elements of a packed list.
  void raw_varint(std::uint64_t value) {
    room(kMaxVarintBytes);
    put_varint(value);
  }
  void raw_fixed64(std::uint64_t value) {
    room(sizeof value);
    put(&value, sizeof value);
  }

  // Appends a field whose content `fill()` appends: a message, or a packed list.
  template <typename Fill>
  void nested(std::uint32_t number, const Fill& fill) {
    room(kMaxVarintBytes + 1);
    tag(number, WireType::kLength);
    const std::size_t begin = ++end_;  // behind a length of one byte
    fill();
    const std::size_t length = end_ - begin;
    out_[begin - 1] = static_cast<char>(length);
    if (length >= 0x80) widen_length(begin);
  }

  std::string take() {
    out_.resize(end_);
    return std::move(out_);
  }

 private:
  static constexpr std::size_t kUsualBytes = 512;  // the header of a step or of its reply has fewer

  // Makes room for so many bytes at end_; put_varint() and put() do not look for it.
  void room(std::size_t bytes) {
    if (out_.size() - end_ < bytes) grow(bytes);
  }
  // Seven bits in each byte, the lowest bits first; the top bit is set if another byte follows.
  void put_varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) out_[end_++] = static_cast<char>(value | 0x80);
    out_[end_++] = static_cast<char>(value);
  }
  void put(const void* bytes, std::size_t size) {
    if (size != 0) std::memcpy(out_.data() + end_, bytes, size);
    end_ += size;
  }
  void tag(std::uint32_t number, WireType type) {
    put_varint(std::uint64_t{number} << 3 | static_cast<std::uint32_t>(type));
  }
  void grow(std::size_t bytes);
  void widen_length(std::size_t begin);

  std::string out_;      // has room behind the message
  std::size_t end_ = 0;  // of the message
};

// A field of an encoded message.
struct EncodedField {
  std::uint32_t number = 0;
  WireType type = WireType::kVarint;
  std::uint64_t value = 0;           // value of a varint or fixed number
  std::span<const std::byte> bytes;  // content of a field with a length

  std::string_view text() const { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }
};

// Reads the fields of a message one after the other. A field that is cut short, or of an unknown wire type (such as a
// group), is a fault.
class Decoder {
 public:
  explicit Decoder(std::span<const std::byte> message) : message_(message) {}

  bool next(EncodedField& field);           // reads the next field; false at the end, and at a fault
  bool next_varint(std::uint64_t& value);   // reads an element of a packed list; false at the end, and at a fault
  bool next_fixed64(std::uint64_t& value);  // reads an element of a packed list; false at the end, and at a fault
  std::size_t position() const { return at_; }
  bool fault() const { return fault_; }

 private:
  bool fail() {
    fault_ = true;
    return false;
  }
  bool read_varint(std::uint64_t& value);
  template <typename Number>
  bool read_fixed(std::uint64_t& value);

  std::span<const std::byte> message_;
  std::size_t at_ = 0;
  bool fault_ = false;
};

}  // namespace shearbus::wire
