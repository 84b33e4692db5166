// Writes and reads any struct that has rows (field_rows.hpp). The rules for texts, ids, enums and lists are written
// only here.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <concepts>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "proto/wire/encoding.hpp"
#include "proto/wire/enum_names.hpp"
#include "proto/wire/field_rows.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::wire {

// The path of a field in a message: "downscale.wanted".
struct FieldPath {
  const FieldPath* parent = nullptr;
  const char* name = "";  // "" for the header itself

  std::string text() const {
    const std::string before = parent ? parent->text() : "";
    return before.empty() ? name : before + "." + name;
  }
};

[[noreturn]] inline void refuse_field(Code code, const FieldPath& path, const std::string& fault) {
  const std::string text = path.text();
  throw Error({.code = code, .text = (text.empty() ? "the header" : text) + " " + fault, .field = text});
}

template <typename T>
concept Varint = std::unsigned_integral<T> || std::is_enum_v<T>;

// ---- writing ----

// Returns text that a peer accepts: valid UTF-8 of at most `most` bytes. A longer text is cut, an invalid byte is
// replaced.
inline std::string sent_text(const std::string& text, std::size_t most = kMaxTextBytes) {
  return text.size() <= most && is_utf8(text) ? text : as_utf8(text, most);
}

// Writes the fields that differ from the default of proto3, zero or empty. A field that is a message is always written.
class FieldWriter {
 public:
  explicit FieldWriter(Encoder& out, const FieldPath& path = {}) : out_(out), path_(path) {}

  template <typename T>
  void operator()(std::uint32_t number, const char* name, const T& value) const {
    if constexpr (HasRows<const T>)
      write_message(number, {&path_, name}, value);
    else
      write(number, value);
  }
  template <typename T>
  void operator()(std::uint32_t number, const char* name, const Row<As::kSceneText, T>& row) const {
    const FieldPath path{&path_, name};
    const std::string& text = row.value;
    if (text.size() > kMaxSceneBytes)
      refuse_field(Code::kLimit, path, fmt::format("has {} bytes, at most {} allowed", text.size(), kMaxSceneBytes));
    if (!is_utf8(text)) refuse_field(Code::kInvalidScene, path, "is not UTF-8");
    out_.bytes(number, text);
  }

 private:
  template <Varint T>
  void write(std::uint32_t number, T value) const {
    if (value != T{}) out_.varint(number, static_cast<std::uint64_t>(value));
  }
  void write(std::uint32_t number, double value) const {
    if (const auto bits = std::bit_cast<std::uint64_t>(value); bits != 0) out_.fixed64(number, bits);
  }
  void write(std::uint32_t number, const std::string& value) const {
    if (!value.empty()) out_.bytes(number, sent_text(value));
  }
  void write(std::uint32_t number, const Id& value) const {
    if (value != Id{}) out_.bytes(number, {reinterpret_cast<const char*>(value.data()), value.size()});
  }
  template <HasRows T>
  void write(std::uint32_t number, const T& value) const {
    write_message(number, path_, value);
  }
  template <typename T>
  void write_message(std::uint32_t number, const FieldPath& path, const T& value) const {
    out_.nested(number, [&] { T::fields(FieldWriter(out_, path), value); });
  }
  template <typename T>
  void write(std::uint32_t number, const std::vector<T>& values, bool as_fixed64 = false) const {
    write(number, std::span<const T>(values), as_fixed64);
  }
  template <typename T>
  void write(std::uint32_t number, std::span<const T> values, bool as_fixed64 = false) const {
    if constexpr (Varint<T>) {
      if (values.empty()) return;
      out_.nested(number, [&] {
        for (const T value : values) {
          const auto bits = static_cast<std::uint64_t>(value);
          as_fixed64 ? out_.raw_fixed64(bits) : out_.raw_varint(bits);
        }
      });
    } else if constexpr (std::same_as<T, std::string>) {
      for (const T& value : values) out_.bytes(number, sent_text(value));
    } else {
      for (const T& value : values) write(number, value);
    }
  }
  template <As kAs, typename T>
  void write(std::uint32_t number, const Row<kAs, T>& row) const {
    if constexpr (kAs == As::kFixed) {
      if (row.value != 0) out_.fixed64(number, row.value);
    } else if constexpr (kAs == As::kLongText) {
      if (!row.value.empty()) out_.bytes(number, sent_text(row.value, kMaxSceneBytes));
    } else {
      write(number, row.value);
    }
  }
  template <typename T>
  void write(std::uint32_t number, const AtMost<T>& row) const {
    write(number, row.value, row.fixed);
  }

  Encoder& out_;
  FieldPath path_;
};

// ---- reading ----

template <HasRows T>
void read_message(T& message, std::span<const std::byte> bytes, const FieldPath& path, bool strict);

// Returns an id of 16 bytes; all zero if `bytes` is empty.
inline Id read_id(std::span<const std::byte> bytes, const FieldPath& path) {
  Id id{};
  if (!bytes.empty() && bytes.size() != id.size())
    refuse_field(Code::kMalformed, path, fmt::format("has {} bytes, expected {} (or none)", bytes.size(), id.size()));
  for (std::size_t i = 0; i < bytes.size(); ++i) id[i] = std::to_integer<std::uint8_t>(bytes[i]);
  return id;
}

// Sets every field to the default of proto3, which may differ from the default of the struct.
struct FieldClearer {
  template <typename T>
  void operator()(std::uint32_t, const char*, T&& row) const {
    if constexpr (requires { row.value = {}; } && !HasRows<std::remove_cvref_t<T>>)
      row.value = {};
    else
      row = {};
  }
};

// Refuses a message that lacks a required field.
struct RequiredFields {
  const FieldPath& path;
  std::uint64_t found;  // bit n: field n was in the message

  template <typename T>
  void operator()(std::uint32_t, const char*, const T&) const {}
  template <typename T>
  void operator()(std::uint32_t number, const char* name, const Row<As::kRequired, T>& row) const {
    const bool given = (found >> number & 1U) != 0;
    if constexpr (std::is_enum_v<T>) {
      if (!given || row.value == T{})
        refuse_field(Code::kMalformed, {&path, name}, "is not given, expected " + names_of(row.value).choices());
    } else if (!given) {
      refuse_field(Code::kMalformed, {&path, name}, "is not given");
    }
  }
  template <typename T>
  void operator()(std::uint32_t, const char* name, const Row<As::kSceneText, T>& row) const {
    if (row.value.empty()) refuse_field(Code::kMalformed, {&path, name}, "is not given");
  }
};

// Reads one encoded field of a message into the member of the struct that has the field's number.
class FieldReader {
 public:
  FieldReader(const EncodedField& found, const FieldPath& path, bool strict)
      : found_(found), path_(path), strict_(strict) {}

  bool known() const { return known_; }  // true if a member with the number and type of the encoded field was found

  template <typename T>
  void operator()(std::uint32_t number, const char* name, T&& row) {
    if (number == found_.number) read({&path_, name}, row);
  }

 private:
  static constexpr std::size_t kAnyCount = std::numeric_limits<std::size_t>::max();
  static constexpr std::size_t kUsualCount = 16;  // entries of a list for which memory is allocated at once

  bool is(WireType type) {
    const bool same = found_.type == type;
    known_ = known_ || same;
    return same;
  }
  template <Varint T>
  static T number_as(std::uint64_t value, const FieldPath& path) {
    if constexpr (std::is_enum_v<T>)
      if (!may_be_sent(T{}, value))
        refuse_field(Code::kMalformed, path, fmt::format("= {} is no value of {}", value, names_of(T{}).type));
    return static_cast<T>(value);
  }
  std::string text(const FieldPath& path, std::size_t most = kMaxTextBytes) const {
    if (found_.bytes.size() > most)
      refuse_field(Code::kLimit, path, fmt::format("has {} bytes, at most {} allowed", found_.bytes.size(), most));
    if (!is_utf8(found_.text())) refuse_field(Code::kMalformed, path, "is not UTF-8");
    return std::string(found_.text());
  }

  template <Varint T>
  void read(const FieldPath& path, T& value) {
    if (is(WireType::kVarint)) value = number_as<T>(found_.value, path);
  }
  void read(const FieldPath&, double& value) {
    if (is(WireType::kFixed64)) value = std::bit_cast<double>(found_.value);
  }
  void read(const FieldPath& path, std::string& value) {
    if (is(WireType::kLength)) value = text(path);
  }
  void read(const FieldPath& path, Id& value) {
    if (is(WireType::kLength)) value = read_id(found_.bytes, path);
  }
  template <HasRows T>
  void read(const FieldPath& path, T& value) {
    if (is(WireType::kLength)) read_message(value, found_.bytes, path, strict_);
  }
  template <As kAs, typename T>
  void read(const FieldPath& path, Row<kAs, T>& row) {
    if constexpr (kAs == As::kFixed) {
      if (is(WireType::kFixed64)) row.value = found_.value;
    } else if constexpr (kAs == As::kRequired) {
      read(path, row.value);
    } else if constexpr (kAs == As::kKnownOnly) {
      std::vector<std::uint32_t> numbers;
      read(path, numbers);
      for (const std::uint32_t number : numbers)
        if (number != 0 && may_be_sent(Field{}, number)) row.value.push_back(static_cast<Field>(number));
    } else {
      if (is(WireType::kLength)) row.value = text(path, kMaxSceneBytes);
    }
  }
  template <typename T>
  void read(const FieldPath& path, AtMost<T>& row) {
    read(path, row.value, row.most, row.fixed);
  }
  // A list of numbers is packed in one field, or each number has a field of its own.
  template <typename T>
  void read(const FieldPath& path, std::vector<T>& values, std::size_t most = kAnyCount, bool as_fixed64 = false) {
    constexpr bool kColumns = std::same_as<T, Field> || std::same_as<T, Column>;
    const auto append = [&](T value) {
      if (values.size() == most)
        refuse_field(kColumns ? Code::kShape : Code::kLimit, path, fmt::format("has more than {} entries", most));
      if (most != kAnyCount && values.empty()) values.reserve(std::min(most, kUsualCount));
      values.push_back(std::move(value));
    };
    if constexpr (Varint<T>) {
      const auto number = [&](std::uint64_t value) {
        if constexpr (std::same_as<T, Field>)
          if (value == 0 || !may_be_sent(Field{}, value))
            refuse_field(Code::kShape, path,
                         fmt::format("names column {}, which is not a field of this protocol", value));
        append(number_as<T>(value, path));
      };
      if (found_.type == (as_fixed64 ? WireType::kFixed64 : WireType::kVarint)) {
        known_ = true;
        number(found_.value);
      } else if (is(WireType::kLength)) {
        Decoder packed(found_.bytes);
        std::uint64_t value = 0;
        while (as_fixed64 ? packed.next_fixed64(value) : packed.next_varint(value)) number(value);
        if (packed.fault()) refuse_field(Code::kMalformed, path, "does not parse");
      }
    } else if (found_.type == WireType::kLength) {
      T value{};
      read(path, value);
      append(std::move(value));
    }
  }

  const EncodedField& found_;
  const FieldPath& path_;
  bool strict_;
  bool known_ = false;
};

// Refuses an unknown field. A reader that is not `strict` skips unknown fields instead.
inline void refuse_unknown(std::uint32_t number, const FieldPath& path) {
  throw Error(
      {.code = Code::kMalformed,
       .text = fmt::format("{} has a field number {} that protocol {}.{} does not know",
                           path.text().empty() ? "the header" : path.text(), number, kProtocolMajor, kProtocolMinor),
       .remedy = "A sender with newer fields says so in protocol_minor.",
       .field = path.text()});
}

template <HasRows T>
void read_message(T& message, std::span<const std::byte> bytes, const FieldPath& path, bool strict) {
  T::fields(FieldClearer{}, message);
  Decoder in(bytes);
  EncodedField found;
  std::uint64_t numbers = 0;  // bit n: field n was found, with the type of the member
  while (in.next(found)) {
    FieldReader reader(found, path, strict);
    T::fields(reader, message);
    if (reader.known() && found.number < 64) numbers |= std::uint64_t{1} << found.number;
    if (!reader.known() && strict) refuse_unknown(found.number, path);
  }
  if (in.fault()) refuse_field(Code::kMalformed, path, "does not parse");
  T::fields(RequiredFields{path, numbers}, message);
}

}  // namespace shearbus::wire
