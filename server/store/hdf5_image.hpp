// The part of HDF5 that checkpoints need: files in memory, groups, and attributes and datasets of numbers and text.
// Every failed call throws an Hdf5Error that names the operation.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "proto/files/hdf5.hpp"

namespace shearbus::store {

class Hdf5Error : public std::runtime_error {
 public:
  explicit Hdf5Error(const std::string& doing) : std::runtime_error("HDF5 could not " + doing) {}
};

// Returns the id, or throws an Hdf5Error for a negative id. Its text is composed only for a
// negative id: composing may throw, and a valid id must reach the handle that owns it before anything throws.
hid_t checked(hid_t id, std::string_view doing, std::string_view what = {});

template <typename Number>
hid_t hdf5_type() {
  if constexpr (std::is_same_v<Number, double>) {
    return H5T_IEEE_F64LE;
  } else if constexpr (std::is_same_v<Number, std::uint64_t>) {
    return H5T_STD_U64LE;
  } else if constexpr (std::is_same_v<Number, std::uint32_t>) {
    return H5T_STD_U32LE;
  } else {
    static_assert(sizeof(Number) == 1);
    return H5T_STD_U8LE;
  }
}

// The name of a file in memory. HDF5 refuses an image if a file of the same name exists on the disk. No file can
// exist under /dev/null, which is no directory.
inline constexpr const char* kImageName = "/dev/null/checkpoint";

hdf5::File new_image();                                   // creates an empty file in memory
hdf5::File open_image(std::span<const std::byte> image);  // opens an image for reading
std::vector<std::byte> bytes_of_image(hid_t file);

hdf5::Group make_group(hid_t parent, const std::string& name);
hdf5::Group open_group(hid_t parent, const std::string& name);
bool has_child(hid_t parent, const std::string& name);
bool has_attribute(hid_t object, const std::string& name);
std::vector<std::string> children_of(hid_t group);  // names in ascending order

void put_text(hid_t object, const std::string& name, const std::string& text);
// Writes a text as a dataset, which may be longer than the 64 kB of an attribute.
void put_text_dataset(hid_t group, const std::string& name, const std::string& text);
std::string text_in_dataset(hid_t group, const std::string& name);
void put_number(hid_t object, const std::string& name, std::uint64_t value);
std::string text_of(hid_t object, const std::string& name);
std::uint64_t number_of(hid_t object, const std::string& name);

// Writes a dataset of shape [rows] if width is 0, else [rows][width].
hdf5::Dataset put_raw(hid_t group, const std::string& name, hid_t type, const void* data, std::size_t rows,
                      std::size_t width);
struct Extent {
  std::size_t rows = 0;
  std::size_t width = 0;
};
Extent extent_of(hid_t dataset, const std::string& name);
hdf5::Dataset open_dataset(hid_t group, const std::string& name, hid_t type);
void get_raw(hid_t dataset, const std::string& name, hid_t type, void* data);

template <typename Number>
hdf5::Dataset put_numbers(hid_t group, const std::string& name, const std::vector<Number>& values, std::size_t rows,
                          std::size_t width = 0) {
  return put_raw(group, name, hdf5_type<Number>(), values.data(), rows, width);
}

template <typename Number>
std::vector<Number> numbers_of(hid_t group, const std::string& name, std::size_t* width = nullptr) {
  const hdf5::Dataset dataset = open_dataset(group, name, hdf5_type<Number>());
  const Extent extent = extent_of(dataset, name);
  std::vector<Number> values(extent.rows * (extent.width == 0 ? 1 : extent.width));
  if (!values.empty()) get_raw(dataset, name, hdf5_type<Number>(), values.data());
  if (width != nullptr) *width = extent.width;
  return values;
}

}  // namespace shearbus::store
