#include "server/store/hdf5_image.hpp"

namespace shearbus::store {
namespace {

constexpr std::size_t kGrowBy = std::size_t{1} << 20;  // an image that is being built grows by this size  [bytes]

// Switches off HDF5's printing of its error stack: Hdf5Error names the operation that failed.
void be_quiet() {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

void check(herr_t result, const std::string& doing) {
  if (result < 0) throw Hdf5Error(doing);
}

hdf5::Properties in_memory() {
  hdf5::Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), "make a property list"));
  check(H5Pset_fapl_core(access, kGrowBy, 0), "keep a file in memory");
  return access;
}

hdf5::Type text_type(std::size_t size) {
  hdf5::Type type(checked(H5Tcopy(H5T_C_S1), "make a text type"));
  check(H5Tset_size(type, size), "size a text type");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "make a text type UTF-8");
  check(H5Tset_strpad(type, H5T_STR_NULLPAD), "make a text type");
  return type;
}

// Throws unless the data space has exactly one value: HDF5 reads as many values as the file declares, and the buffer
// has room for one.
void check_single(hid_t space, const std::string& name) {
  if (H5Sget_simple_extent_npoints(space) != 1) throw Hdf5Error("read one value from " + name);
}

// Throws unless the file stores as many bytes as extent and type of the dataset declare. Otherwise a damaged extent
// could exhaust the memory.
void check_room(hid_t dataset, hid_t space, const std::string& name) {
  const hdf5::Type type(checked(H5Dget_type(dataset), "type dataset ", name));
  const hssize_t count = H5Sget_simple_extent_npoints(space);
  const std::size_t size = H5Tget_size(type);
  if (count < 0 || size == 0 || static_cast<hsize_t>(count) > H5Dget_storage_size(dataset) / size)
    throw Hdf5Error("find all of dataset " + name);
}

hdf5::Attribute open_attribute(hid_t object, const std::string& name) {
  return hdf5::Attribute(checked(H5Aopen(object, name.c_str(), H5P_DEFAULT), "find attribute ", name));
}

}  // namespace

hid_t checked(hid_t id, std::string_view doing, std::string_view what) {
  if (id < 0) throw Hdf5Error(std::string(doing).append(what));
  return id;
}

hdf5::File new_image() {
  be_quiet();
  const hdf5::Properties access = in_memory();
  return hdf5::File(checked(H5Fcreate(kImageName, H5F_ACC_TRUNC, H5P_DEFAULT, access), "make a file in memory"));
}

hdf5::File open_image(std::span<const std::byte> image) {
  be_quiet();
  const hdf5::Properties access = in_memory();
  // The cast is safe: H5Pset_file_image only copies the bytes, although its parameter is not const.
  check(H5Pset_file_image(access, const_cast<std::byte*>(image.data()), image.size()), "take a file image");
  return hdf5::File(checked(H5Fopen(kImageName, H5F_ACC_RDONLY, access), "open a file image"));
}

std::vector<std::byte> bytes_of_image(hid_t file) {
  check(H5Fflush(file, H5F_SCOPE_GLOBAL), "flush a file in memory");
  const ssize_t size = H5Fget_file_image(file, nullptr, 0);
  if (size < 0) throw Hdf5Error("size a file image");
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  if (H5Fget_file_image(file, bytes.data(), bytes.size()) != size) throw Hdf5Error("give a file image");
  return bytes;
}

hdf5::Group make_group(hid_t parent, const std::string& name) {
  return hdf5::Group(
      checked(H5Gcreate2(parent, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "make group ", name));
}

hdf5::Group open_group(hid_t parent, const std::string& name) {
  return hdf5::Group(checked(H5Gopen2(parent, name.c_str(), H5P_DEFAULT), "find group ", name));
}

bool has_child(hid_t parent, const std::string& name) {
  const htri_t found = H5Lexists(parent, name.c_str(), H5P_DEFAULT);
  if (found < 0) throw Hdf5Error("look for " + name);
  return found > 0;
}

bool has_attribute(hid_t object, const std::string& name) {
  const htri_t found = H5Aexists(object, name.c_str());
  if (found < 0) throw Hdf5Error("look for " + name);
  return found > 0;
}

std::vector<std::string> children_of(hid_t group) {
  H5G_info_t info{};
  check(H5Gget_info(group, &info), "look into a group");
  std::vector<std::string> names;
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    const auto name = [&](char* text, std::size_t size) {
      return H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, text, size, H5P_DEFAULT);
    };
    const ssize_t length = name(nullptr, 0);
    if (length < 0) throw Hdf5Error("name the members of a group");
    std::string text(static_cast<std::size_t>(length), '\0');
    name(text.data(), text.size() + 1);
    names.push_back(std::move(text));
  }
  return names;
}

void put_text(hid_t object, const std::string& name, const std::string& text) {
  const hdf5::Type type = text_type(text.empty() ? 1 : text.size());
  const hdf5::Space space(checked(H5Screate(H5S_SCALAR), "make a space"));
  const hdf5::Attribute attribute(
      checked(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), "make attribute ", name));
  check(H5Awrite(attribute, type, text.c_str()), "write attribute " + name);
}

void put_text_dataset(hid_t group, const std::string& name, const std::string& text) {
  const hdf5::Type type = text_type(text.empty() ? 1 : text.size());
  const hdf5::Space space(checked(H5Screate(H5S_SCALAR), "make a space"));
  const hdf5::Dataset dataset(checked(
      H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "make dataset ", name));
  check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.c_str()), "write dataset " + name);
}

std::string text_in_dataset(hid_t group, const std::string& name) {
  const hdf5::Dataset dataset(checked(H5Dopen2(group, name.c_str(), H5P_DEFAULT), "find dataset ", name));
  const hdf5::Type type(checked(H5Dget_type(dataset), "type dataset ", name));
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0)
    throw Hdf5Error("read text from dataset " + name);
  const hdf5::Space space(checked(H5Dget_space(dataset), "size dataset ", name));
  check_single(space, name);
  check_room(dataset, space, name);
  std::string text(H5Tget_size(type), '\0');
  check(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()), "read dataset " + name);
  text.resize(text.find_last_not_of('\0') + 1);
  return text;
}

void put_number(hid_t object, const std::string& name, std::uint64_t value) {
  const hdf5::Space space(checked(H5Screate(H5S_SCALAR), "make a space"));
  const hdf5::Attribute attribute(checked(
      H5Acreate2(object, name.c_str(), H5T_STD_U64LE, space, H5P_DEFAULT, H5P_DEFAULT), "make attribute ", name));
  check(H5Awrite(attribute, H5T_NATIVE_UINT64, &value), "write attribute " + name);
}

std::string text_of(hid_t object, const std::string& name) {
  const hdf5::Attribute attribute = open_attribute(object, name);
  const hdf5::Type type(checked(H5Aget_type(attribute), "type attribute ", name));
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0)
    throw Hdf5Error("read text from attribute " + name);
  check_single(hdf5::Space(checked(H5Aget_space(attribute), "size attribute ", name)), name);
  std::string text(H5Tget_size(type), '\0');
  check(H5Aread(attribute, type, text.data()), "read attribute " + name);
  text.resize(text.find_last_not_of('\0') + 1);
  return text;
}

std::uint64_t number_of(hid_t object, const std::string& name) {
  const hdf5::Attribute attribute = open_attribute(object, name);
  check_single(hdf5::Space(checked(H5Aget_space(attribute), "size attribute ", name)), name);
  std::uint64_t value = 0;
  check(H5Aread(attribute, H5T_NATIVE_UINT64, &value), "read attribute " + name);
  return value;
}

hdf5::Dataset put_raw(hid_t group, const std::string& name, hid_t type, const void* data, std::size_t rows,
                      std::size_t width) {
  const hsize_t extent[2] = {rows, width};
  const hdf5::Space space(checked(H5Screate_simple(width == 0 ? 1 : 2, extent, nullptr), "make a space"));
  hdf5::Dataset dataset(checked(H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                                "make dataset ", name));
  if (rows != 0) check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data), "write dataset " + name);
  return dataset;
}

hdf5::Dataset open_dataset(hid_t group, const std::string& name, hid_t type) {
  hdf5::Dataset dataset(checked(H5Dopen2(group, name.c_str(), H5P_DEFAULT), "find dataset ", name));
  const hdf5::Type found(checked(H5Dget_type(dataset), "type dataset ", name));
  if (H5Tequal(found, type) <= 0) throw Hdf5Error("read dataset " + name + " as numbers of the type expected");
  return dataset;
}

Extent extent_of(hid_t dataset, const std::string& name) {
  const hdf5::Space space(checked(H5Dget_space(dataset), "size dataset ", name));
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank != 1 && rank != 2) throw Hdf5Error("read dataset " + name + " as a list or table");
  check_room(dataset, space, name);
  hsize_t extent[2] = {0, 0};
  H5Sget_simple_extent_dims(space, extent, nullptr);
  // A width of 0 is reserved for lists, which have rank 1.
  if (rank == 2 && extent[1] == 0) throw Hdf5Error("find columns in table " + name);
  return {extent[0], extent[1]};
}

void get_raw(hid_t dataset, const std::string& name, hid_t type, void* data) {
  check(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data), "read dataset " + name);
}

}  // namespace shearbus::store
