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

// Numbers, texts and ids are attributes, lists and numbers with a fraction are datasets.
template <typename Value>
void put(hid_t group, const std::string& name, const Value& value) {
  if constexpr (std::is_same_v<Value, double>)
    put_numbers(group, name, std::vector<double>{value}, 1);
  else if constexpr (std::is_integral_v<Value>)
    put_number(group, name, value);
  else if constexpr (std::is_same_v<Value, std::string>)
    hdf5::put_text(group, name, value);
  else if constexpr (std::is_same_v<Value, SessionKey>)
    hdf5::put_text(group, name, hexadecimal(value));
  else
    put_numbers(group, name, value, value.size());
}
template <typename Value>
void get(hid_t group, const std::string& name, Value& value) {
  if constexpr (std::is_same_v<Value, double>) {
    const auto numbers = numbers_of<double>(group, name);
    if (numbers.size() != 1) throw hdf5::Error("find one number in " + name);
    value = numbers.front();
  } else if constexpr (std::is_integral_v<Value>) {
    value = static_cast<Value>(number_of(group, name));
  } else if constexpr (std::is_same_v<Value, std::string>) {
    value = text_of(group, name);
  } else if constexpr (std::is_same_v<Value, SessionKey>) {
    value = key_from(text_of(group, name));
  } else {
    value = numbers_of<typename Value::value_type>(group, name);
  }
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
