// The rows of the fields of a message. Each struct of a message names every field once,
//
//   static void fields(auto&& v, auto& m) { v(1, "dt_s", m.dt_s); ... }
//
// with the number and name of the .proto file, and field_codec.hpp writes and reads any such struct. The type of a
// member determines its encoding: bool, unsigned numbers and enums are varints, double is fixed64; texts, ids of 16
// bytes (absent if all zero), structs with rows, and vectors of these are allowed too. The wrappers below add
// properties that a type does not express.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace shearbus::wire {

using Id = std::array<std::uint8_t, 16>;  // random bytes; all zero: no id

// What the type of a member does not say.
enum class As {
  kFixed,      // a number that is encoded as fixed64
  kRequired,   // a field that a message must have; for an enum, the value kUnspecified is refused too
  kKnownOnly,  // a list of columns that the sender knows; those that the reader does not know are left out
  kSceneText,  // the text of a scene: required, possibly longer than other texts, and never cut or changed
  kLongText,   // a text that may be as long as that of a scene, because it lists the faults of a scene
};
template <As kAs, typename T>
struct Row {
  T& value;
};
template <As kAs>
struct RowAs {
  template <typename T>
  constexpr Row<kAs, T> operator()(T& value) const {
    return {value};
  }
};
inline constexpr RowAs<As::kFixed> fixed;
inline constexpr RowAs<As::kRequired> required;
inline constexpr RowAs<As::kKnownOnly> known_only;
inline constexpr RowAs<As::kSceneText> scene_text;
inline constexpr RowAs<As::kLongText> long_text;

// A vector of at most `most` elements; a message with more is refused. If `fixed` is true, its numbers are encoded as
// fixed64.
template <typename T>
struct AtMost {
  T& value;
  std::size_t most;
  bool fixed = false;
};
template <typename T>
AtMost<T> at_most(std::size_t most, T& value) {
  return {value, most};
}
template <typename T>
AtMost<T> at_most_fixed(std::size_t most, T& value) {
  return {value, most, true};
}

// The body of a message: its number and name in the oneof of the header.
struct BodyRow {
  std::uint32_t number;
  const char* name;
  bool payload = false;  // may come with a payload frame
};

template <typename T>
concept HasRows = requires(T& message) {
  T::fields([](auto&&...) {}, message);
};

}  // namespace shearbus::wire
