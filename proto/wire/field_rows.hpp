// What the rows of a message's fields are made of. Each struct of a message names every field once,
//
//   static void fields(auto&& v, auto& m) { v(1, "dt_s", m.dt_s); ... }
//
// with the number and name of the .proto file, and field_codec.hpp writes and reads any such struct. The type of a
// member says how it is encoded: bool, unsigned numbers and enums as varints, double as fixed64, text, an id of 16 bytes
// (absent where it is all zero), a struct with rows, and vectors of these. The wrappers below say what a type does not.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace shearbus::wire {

using Id = std::array<std::uint8_t, 16>;  // random bytes; all zero: none

// A number that is encoded as fixed64.
template <typename T>
struct Fixed {
  T& value;
};
template <typename T>
Fixed<T> fixed(T& value) {
  return {value};
}

// A field that a message must have; of an enum, kUnspecified is refused too.
template <typename T>
struct Required {
  T& value;
};
template <typename T>
Required<T> required(T& value) {
  return {value};
}

// A vector of at most `most` elements; a message with more is refused. `fixed`: numbers that are encoded as fixed64.
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

// Columns that a peer offers: those that this side does not know are left out.
template <typename T>
struct KnownOnly {
  T& value;
};
template <typename T>
KnownOnly<T> known_only(T& value) {
  return {value};
}

// The text of a scene: required, longer than other texts may be, and never cut or mended.
template <typename T>
struct SceneText {
  using IsSceneText = void;
  T& value;
};
template <typename T>
SceneText<T> scene_text(T& value) {
  return {value};
}

// A text that may be as long as that of a scene, because it lists the faults of one.
template <typename T>
struct LongText {
  T& value;
};
template <typename T>
LongText<T> long_text(T& value) {
  return {value};
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
