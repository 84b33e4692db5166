// Files of HDF5 in memory, and attributes and datasets of numbers and text that are read only if they are as expected:
// what checkpoints and capsules need. Throws hdf5::Error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "proto/files/hdf5.hpp"

namespace shearbus::store {

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

// Writes a text as a dataset, which may be longer than the 64 kB of an attribute.
void put_text_dataset(hid_t group, const std::string& name, const std::string& text);
std::string text_in_dataset(hid_t group, const std::string& name);
void put_number(hid_t object, const std::string& name, std::uint64_t value);
std::string text_of(hid_t object, const std::string& name);
std::uint64_t number_of(hid_t object, const std::string& name);

struct Numbers {
  hdf5::Dataset dataset;
  std::size_t rows = 0;
  std::size_t width = 0;  // 0: a list
};
Numbers open_numbers(hid_t group, const std::string& name, hid_t type);

// Writes a dataset of shape [rows] if width is 0, else [rows][width].
template <typename Number>
hdf5::Dataset put_numbers(hid_t group, const std::string& name, const std::vector<Number>& values, std::size_t rows,
                          std::size_t width = 0) {
  const hdf5::Shape shape = width == 0 ? hdf5::Shape{rows} : hdf5::Shape{rows, width};
  hdf5::Dataset dataset = hdf5::make_dataset(group, name, hdf5_type<Number>(), shape);
  if (rows != 0) hdf5::write(dataset, hdf5_type<Number>(), values.data());
  return dataset;
}

template <typename Number>
std::vector<Number> numbers_of(hid_t group, const std::string& name, std::size_t* width = nullptr) {
  const Numbers found = open_numbers(group, name, hdf5_type<Number>());
  std::vector<Number> values(found.rows * (found.width == 0 ? 1 : found.width));
  if (!values.empty()) hdf5::read(found.dataset, hdf5_type<Number>(), values.data());
  if (width != nullptr) *width = found.width;
  return values;
}

}  // namespace shearbus::store
