// HDF5: handles that close themselves, and calls that throw what HDF5 could not do. The recordings, the fields, the
// restart dumps and the checkpoints of server/store use these; no other code wraps HDF5 ids.
//
// `values` is an attribute or a dataset, for which HDF5 has the same calls under two names.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/handle.hpp"

namespace shearbus::hdf5 {

using File = wire::Handle<hid_t, H5Fclose>;
using Group = wire::Handle<hid_t, H5Gclose>;
using Dataset = wire::Handle<hid_t, H5Dclose>;
using Space = wire::Handle<hid_t, H5Sclose>;
using Type = wire::Handle<hid_t, H5Tclose>;
using Attribute = wire::Handle<hid_t, H5Aclose>;
using Properties = wire::Handle<hid_t, H5Pclose>;
using Object = wire::Handle<hid_t, H5Oclose>;
using Shape = std::vector<hsize_t>;

// Keeps HDF5 from printing its error stack for as long as the object lives.
class Quiet {
 public:
  Quiet() {
    H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~Quiet() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;

 private:
  H5E_auto2_t function_ = nullptr;
  void* data_ = nullptr;
};

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& doing) : std::runtime_error("HDF5 could not " + doing) {}
};

// Returns the innermost entry of HDF5's error stack, which names the cause. The outer entries name only the calls
// around it.
std::string reason();
[[noreturn]] void fail(std::string_view doing, std::string_view what);  // with the reason

// Returns what a call of HDF5 returned; throws Error for a negative value. The text is composed only then: composing
// may throw, and a valid id must reach the handle that owns it before anything throws.
template <typename T>
T checked(T returned, std::string_view doing, std::string_view what = {}) {
  if (returned < 0) fail(doing, what);
  return returned;
}

Group make_group(hid_t parent, const std::string& name);
Group open_group(hid_t parent, const std::string& name);
std::vector<std::string> children_of(hid_t group);  // names in ascending order
bool has_child(hid_t parent, const std::string& name);
bool has_attribute(hid_t object, const std::string& name);

// UTF-8, filled up with NUL; size H5T_VARIABLE: of any length.
Type text_type(std::size_t size);
// An attribute has one value.
void put_attribute(hid_t object, const std::string& name, hid_t type, const void* value);
void put_text(hid_t object, const std::string& name, const std::string& text);
Attribute open_attribute(hid_t object, const std::string& name);
// Groups in the name are made where they are missing. A shape without dimensions is one value. `most`: the shape to which
// the dataset can grow; empty: its own.
Dataset make_dataset(hid_t parent, const std::string& name, hid_t type, const Shape& shape,
                     hid_t creation = H5P_DEFAULT, const Shape& most = {});
Dataset open_dataset(hid_t parent, const std::string& name);
Properties creation_of(hid_t dataset);

Type type_of(hid_t values);
Space space_of(hid_t values);
Shape shape_of(hid_t values);
std::size_t count_of(hid_t values);
void read(hid_t values, hid_t memory_type, void* out);
void write(hid_t values, hid_t memory_type, const void* in);
// The rows of a table, or elements of a list, from `first` on.
void read_rows(hid_t dataset, hid_t memory_type, std::size_t first, const Shape& rows, void* out);
void write_rows(hid_t dataset, hid_t memory_type, std::size_t first, const Shape& rows, const void* in);
bool is_one_text(hid_t values);
std::vector<std::string> texts_of(hid_t values);

}  // namespace shearbus::hdf5
