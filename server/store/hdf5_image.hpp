// A little of HDF5, enough for checkpoints: files in memory, groups, and attributes and datasets of numbers and text.
// Handles close themselves; every failed call is an Hdf5Error that names what was being done.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace shearbus::store {

class Hdf5Error : public std::runtime_error {
 public:
  explicit Hdf5Error(const std::string& doing) : std::runtime_error("HDF5 could not " + doing) {}
};

class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  // `doing` and `what` are joined only for an error: where the id is good nothing here may fail, or it would stay open.
  Handle(hid_t id, Close close, std::string_view doing, std::string_view what = {}) : id_(id), close_(close) {
    if (id < 0) throw Hdf5Error(std::string(doing).append(what));
  }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  hid_t get() const { return id_; }

 private:
  hid_t id_;
  Close close_;
};

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

// The name of a file in memory: one that no disk can hold. HDF5 looks for it there, and would not open an image beside
// a file of the same name.
inline constexpr const char* kImageName = "/dev/null/checkpoint";

Handle new_image();                                   // an empty file that lives in memory only
Handle open_image(std::span<const std::byte> image);  // to read
std::vector<std::byte> bytes_of_image(const Handle& file);

Handle make_group(const Handle& parent, const std::string& name);
Handle open_group(const Handle& parent, const std::string& name);
bool has_child(const Handle& parent, const std::string& name);
std::vector<std::string> children_of(const Handle& group);  // ascending

void put_text(const Handle& object, const std::string& name, const std::string& text);
void put_text_dataset(const Handle& group, const std::string& name, const std::string& text);  // of any length
std::string text_in_dataset(const Handle& group, const std::string& name);
void put_number(const Handle& object, const std::string& name, std::uint64_t value);
std::string text_of(const Handle& object, const std::string& name);
std::uint64_t number_of(const Handle& object, const std::string& name);

// [rows] where width is 0, else [rows][width].
Handle put_raw(const Handle& group, const std::string& name, hid_t type, const void* data, std::size_t rows,
               std::size_t width);
struct Extent {
  std::size_t rows = 0;
  std::size_t width = 0;
};
Extent extent_of(const Handle& dataset, const std::string& name);
Handle open_dataset(const Handle& group, const std::string& name, hid_t type);
void get_raw(const Handle& dataset, const std::string& name, hid_t type, void* data);

template <typename Number>
Handle put_numbers(const Handle& group, const std::string& name, const std::vector<Number>& values, std::size_t rows,
                   std::size_t width = 0) {
  return put_raw(group, name, hdf5_type<Number>(), values.data(), rows, width);
}

template <typename Number>
std::vector<Number> numbers_of(const Handle& group, const std::string& name, std::size_t* width = nullptr) {
  const Handle dataset = open_dataset(group, name, hdf5_type<Number>());
  const Extent extent = extent_of(dataset, name);
  std::vector<Number> values(extent.rows * (extent.width == 0 ? 1 : extent.width));
  if (!values.empty()) get_raw(dataset, name, hdf5_type<Number>(), values.data());
  if (width != nullptr) *width = extent.width;
  return values;
}

}  // namespace shearbus::store
