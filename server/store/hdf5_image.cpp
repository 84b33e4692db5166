#include "server/store/hdf5_image.hpp"

namespace shearbus::store {
namespace {

constexpr std::size_t kGrowBy = std::size_t{1} << 20;  // of an image being built

// HDF5 prints its error stack by default; our errors say what failed.
void be_quiet() {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

void check(herr_t result, const std::string& doing) {
  if (result < 0) throw Hdf5Error(doing);
}

Handle in_memory() {
  Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "make a property list");
  check(H5Pset_fapl_core(access.get(), kGrowBy, 0), "keep a file in memory");
  return access;
}

Handle text_type(std::size_t size) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose, "make a text type");
  check(H5Tset_size(type.get(), size), "size a text type");
  check(H5Tset_cset(type.get(), H5T_CSET_UTF8), "make a text type UTF-8");
  check(H5Tset_strpad(type.get(), H5T_STR_NULLPAD), "make a text type");
  return type;
}

// What is read is one value: HDF5 writes as many as there are.
void check_single(const Handle& space, const std::string& name) {
  if (H5Sget_simple_extent_npoints(space.get()) != 1) throw Hdf5Error("read one value from " + name);
}

// Memory is taken only for what has its room in the file, whatever extent and type claim.
void check_room(const Handle& dataset, const Handle& space, const std::string& name) {
  const Handle type(H5Dget_type(dataset.get()), H5Tclose, "type dataset ", name);
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  const std::size_t size = H5Tget_size(type.get());
  if (count < 0 || size == 0 || static_cast<hsize_t>(count) > H5Dget_storage_size(dataset.get()) / size)
    throw Hdf5Error("find all of dataset " + name);
}

Handle open_attribute(const Handle& object, const std::string& name) {
  return {H5Aopen(object.get(), name.c_str(), H5P_DEFAULT), H5Aclose, "find attribute ", name};
}

}  // namespace

Handle new_image() {
  be_quiet();
  const Handle access = in_memory();
  return {H5Fcreate(kImageName, H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose, "make a file in memory"};
}

Handle open_image(std::span<const std::byte> image) {
  be_quiet();
  const Handle access = in_memory();
  // The call copies the bytes; its parameter is not const for the sake of other uses.
  check(H5Pset_file_image(access.get(), const_cast<std::byte*>(image.data()), image.size()), "take a file image");
  return {H5Fopen(kImageName, H5F_ACC_RDONLY, access.get()), H5Fclose, "open a file image"};
}

std::vector<std::byte> bytes_of_image(const Handle& file) {
  check(H5Fflush(file.get(), H5F_SCOPE_GLOBAL), "flush a file in memory");
  const ssize_t size = H5Fget_file_image(file.get(), nullptr, 0);
  if (size < 0) throw Hdf5Error("size a file image");
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  if (H5Fget_file_image(file.get(), bytes.data(), bytes.size()) != size) throw Hdf5Error("give a file image");
  return bytes;
}

Handle make_group(const Handle& parent, const std::string& name) {
  return {H5Gcreate2(parent.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose, "make group ", name};
}

Handle open_group(const Handle& parent, const std::string& name) {
  return {H5Gopen2(parent.get(), name.c_str(), H5P_DEFAULT), H5Gclose, "find group ", name};
}

bool has_child(const Handle& parent, const std::string& name) {
  const htri_t found = H5Lexists(parent.get(), name.c_str(), H5P_DEFAULT);
  if (found < 0) throw Hdf5Error("look for " + name);
  return found > 0;
}

std::vector<std::string> children_of(const Handle& group) {
  H5G_info_t info{};
  check(H5Gget_info(group.get(), &info), "look into a group");
  std::vector<std::string> names;
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    const auto name = [&](char* text, std::size_t size) {
      return H5Lget_name_by_idx(group.get(), ".", H5_INDEX_NAME, H5_ITER_INC, i, text, size, H5P_DEFAULT);
    };
    const ssize_t length = name(nullptr, 0);
    if (length < 0) throw Hdf5Error("name the members of a group");
    std::string text(static_cast<std::size_t>(length), '\0');
    name(text.data(), text.size() + 1);
    names.push_back(std::move(text));
  }
  return names;
}

void put_text(const Handle& object, const std::string& name, const std::string& text) {
  const Handle type = text_type(text.empty() ? 1 : text.size());
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "make a space");
  const Handle attribute(H5Acreate2(object.get(), name.c_str(), type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT),
                         H5Aclose, "make attribute ", name);
  check(H5Awrite(attribute.get(), type.get(), text.c_str()), "write attribute " + name);
}

void put_text_dataset(const Handle& group, const std::string& name, const std::string& text) {
  const Handle type = text_type(text.empty() ? 1 : text.size());
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "make a space");
  const Handle dataset(
      H5Dcreate2(group.get(), name.c_str(), type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose,
      "make dataset ", name);
  check(H5Dwrite(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.c_str()), "write dataset " + name);
}

std::string text_in_dataset(const Handle& group, const std::string& name) {
  const Handle dataset(H5Dopen2(group.get(), name.c_str(), H5P_DEFAULT), H5Dclose, "find dataset ", name);
  const Handle type(H5Dget_type(dataset.get()), H5Tclose, "type dataset ", name);
  if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0)
    throw Hdf5Error("read text from dataset " + name);
  const Handle space(H5Dget_space(dataset.get()), H5Sclose, "size dataset ", name);
  check_single(space, name);
  check_room(dataset, space, name);
  std::string text(H5Tget_size(type.get()), '\0');
  check(H5Dread(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()), "read dataset " + name);
  text.resize(text.find_last_not_of('\0') + 1);
  return text;
}

void put_number(const Handle& object, const std::string& name, std::uint64_t value) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "make a space");
  const Handle attribute(H5Acreate2(object.get(), name.c_str(), H5T_STD_U64LE, space.get(), H5P_DEFAULT, H5P_DEFAULT),
                         H5Aclose, "make attribute ", name);
  check(H5Awrite(attribute.get(), H5T_NATIVE_UINT64, &value), "write attribute " + name);
}

std::string text_of(const Handle& object, const std::string& name) {
  const Handle attribute = open_attribute(object, name);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose, "type attribute ", name);
  if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0)
    throw Hdf5Error("read text from attribute " + name);
  check_single(Handle(H5Aget_space(attribute.get()), H5Sclose, "size attribute ", name), name);
  std::string text(H5Tget_size(type.get()), '\0');
  check(H5Aread(attribute.get(), type.get(), text.data()), "read attribute " + name);
  text.resize(text.find_last_not_of('\0') + 1);
  return text;
}

std::uint64_t number_of(const Handle& object, const std::string& name) {
  const Handle attribute = open_attribute(object, name);
  check_single(Handle(H5Aget_space(attribute.get()), H5Sclose, "size attribute ", name), name);
  std::uint64_t value = 0;
  check(H5Aread(attribute.get(), H5T_NATIVE_UINT64, &value), "read attribute " + name);
  return value;
}

Handle put_raw(const Handle& group, const std::string& name, hid_t type, const void* data, std::size_t rows,
               std::size_t width) {
  const hsize_t extent[2] = {rows, width};
  const Handle space(H5Screate_simple(width == 0 ? 1 : 2, extent, nullptr), H5Sclose, "make a space");
  Handle dataset(H5Dcreate2(group.get(), name.c_str(), type, space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                 H5Dclose, "make dataset ", name);
  if (rows != 0) check(H5Dwrite(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data), "write dataset " + name);
  return dataset;
}

Handle open_dataset(const Handle& group, const std::string& name, hid_t type) {
  Handle dataset(H5Dopen2(group.get(), name.c_str(), H5P_DEFAULT), H5Dclose, "find dataset ", name);
  const Handle found(H5Dget_type(dataset.get()), H5Tclose, "type dataset ", name);
  if (H5Tequal(found.get(), type) <= 0) throw Hdf5Error("read dataset " + name + " as numbers of the type expected");
  return dataset;
}

Extent extent_of(const Handle& dataset, const std::string& name) {
  const Handle space(H5Dget_space(dataset.get()), H5Sclose, "size dataset ", name);
  const int rank = H5Sget_simple_extent_ndims(space.get());
  if (rank != 1 && rank != 2) throw Hdf5Error("read dataset " + name + " as a list or table");
  check_room(dataset, space, name);
  hsize_t extent[2] = {0, 0};
  H5Sget_simple_extent_dims(space.get(), extent, nullptr);
  if (rank == 2 && extent[1] == 0) throw Hdf5Error("find columns in table " + name);  // it would pass for a list
  return {extent[0], extent[1]};
}

void get_raw(const Handle& dataset, const std::string& name, hid_t type, void* data) {
  check(H5Dread(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data), "read dataset " + name);
}

}  // namespace shearbus::store
