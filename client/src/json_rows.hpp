// Writes any struct that has rows (proto/wire/field_rows.hpp) as JSON: each field by its name, ids as hexadecimal
// digits, enums as their numbers.
#pragma once

#include <fmt/format.h>

#include <concepts>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "proto/wire/field_rows.hpp"
#include "proto/wire/text.hpp"

namespace shearbus {

class JsonRows {
 public:
  template <wire::HasRows T>
  static std::string of(const T& message) {
    JsonRows json;
    json.object(message);
    return json.text_;
  }
  // Adds the elements of a list to a text: [1, 2].
  template <typename T>
  static void add_list(std::string& text, std::span<const T> values) {
    JsonRows json;
    json.put(values);
    text += json.text_;
  }

  template <typename T>
  void operator()(std::uint32_t, const char* name, const T& row) {
    text_ += fmt::format("{}\"{}\": ", text_.back() == '{' ? "" : ", ", name);
    if constexpr (requires { row.value; } && !wire::HasRows<const T>)
      put(row.value);  // one with a rule
    else
      put(row);
  }

 private:
  template <typename T>
  void object(const T& message) {
    text_ += '{';
    T::fields(*this, message);
    text_ += '}';
  }
  template <typename T>
  void put(const T& value) {
    if constexpr (wire::HasRows<const T>)
      object(value);
    else if constexpr (std::is_enum_v<T>)
      text_ += fmt::format("{}", static_cast<std::uint64_t>(value));
    else
      text_ += fmt::format("{}", value);  // true, 7, 0.5
  }
  void put(const std::string& value) {
    text_ += '"';
    for (const char c : value) {
      if (c == '"' || c == '\\')
        text_ += {'\\', c};
      else if (static_cast<unsigned char>(c) < 0x20)
        text_ += fmt::format("\\u{:04x}", c);
      else
        text_ += c;
    }
    text_ += '"';
  }
  void put(const wire::Id& id) { text_ += '"' + wire::hexadecimal(id) + '"'; }
  template <typename T>
  void put(const std::vector<T>& values) {
    put(std::span<const T>(values));
  }
  template <typename T>
  void put(std::span<const T> values) {
    text_ += '[';
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (i > 0) text_ += ", ";
      put(values[i]);
    }
    text_ += ']';
  }

  std::string text_;
};

}  // namespace shearbus
