// Writes and reads the fields of an image (snapshot.hpp) as attributes, datasets and groups of an HDF5 group.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "server/store/hdf5_image.hpp"
#include "server/store/snapshot.hpp"

namespace shearbus::store {

SessionKey key_from(const std::string& text);  // throws hdf5::Error
std::vector<std::string> words_of(const std::string& text);

// Writes the fields of one image, or reads them with the same names.
template <typename Image>
void put_fields(hid_t group, const Image& image);
template <typename Image>
void get_fields(hid_t group, Image& image);

void put(hid_t group, const std::string& name, const shard::States& states);
void get(hid_t group, const std::string& name, shard::States& states);
void put(hid_t group, const std::string& name, const std::vector<CapsuleValue>& values);
void get(hid_t group, const std::string& name, std::vector<CapsuleValue>& values);
void put(hid_t group, const std::string& name, const std::vector<MarkImage>& marks);
void get(hid_t group, const std::string& name, std::vector<MarkImage>& marks);

inline void put(hid_t group, const std::string& name, std::uint64_t value) {
  put_number(group, name, value);
}
inline void get(hid_t group, const std::string& name, std::uint64_t& value) {
  value = number_of(group, name);
}
inline void put(hid_t group, const std::string& name, bool value) {
  put_number(group, name, value ? 1 : 0);
}
inline void get(hid_t group, const std::string& name, bool& value) {
  value = number_of(group, name) != 0;
}
inline void put(hid_t group, const std::string& name, double value) {
  put_numbers(group, name, std::vector<double>{value}, 1);
}
void get(hid_t group, const std::string& name, double& value);
inline void put(hid_t group, const std::string& name, const std::string& text) {
  hdf5::put_text(group, name, text);
}
inline void get(hid_t group, const std::string& name, std::string& text) {
  text = text_of(group, name);
}
inline void put(hid_t group, const std::string& name, const SessionKey& key) {
  hdf5::put_text(group, name, hexadecimal(key));
}
inline void get(hid_t group, const std::string& name, SessionKey& key) {
  key = key_from(text_of(group, name));
}
template <typename Number>
void put(hid_t group, const std::string& name, const std::vector<Number>& numbers) {
  put_numbers(group, name, numbers, numbers.size());
}
template <typename Number>
void get(hid_t group, const std::string& name, std::vector<Number>& numbers) {
  numbers = numbers_of<Number>(group, name);
}
inline void put(hid_t group, const std::string& name, const std::optional<shard::States>& states) {
  if (states) put(group, name, *states);
}
inline void get(hid_t group, const std::string& name, std::optional<shard::States>& states) {
  if (hdf5::has_child(group, name)) get(group, name, states.emplace());
}

template <typename Value>
bool is_blank(const Value& value) {
  if constexpr (std::is_integral_v<Value>)
    return value == 0;
  else if constexpr (requires { value.empty(); })
    return value.empty();
  else
    return false;
}

template <typename Image>
void put_fields(hid_t group, const Image& image) {
  Image::fields([&](const char* name, auto member, const FieldOf& field) {
    const auto& value = image.*member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if (field.maybe && is_blank(value)) return;
    if constexpr (std::is_same_v<Value, std::string>)
      if (field.dataset) return put_text_dataset(group, name, value);
    put(group, name, value);
  });
}

template <typename Image>
void get_fields(hid_t group, Image& image) {
  Image::fields([&](const char* name, auto member, const FieldOf& field) {
    auto& value = image.*member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if (field.maybe && !hdf5::has_child(group, name) && !hdf5::has_attribute(group, name)) return;
    if constexpr (std::is_same_v<Value, std::string>)
      if (field.dataset) return static_cast<void>(value = text_in_dataset(group, name));
    get(group, name, value);
  });
}

}  // namespace shearbus::store
