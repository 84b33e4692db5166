#include "server/store/hdf5_image.hpp"

#include <algorithm>
#include <utility>

namespace shearbus::store {
namespace {

using hdf5::checked;

constexpr std::size_t kGrowBy = std::size_t{1} << 20;  // an image that is being built grows by this size  [bytes]

hdf5::Properties in_memory() {
  hdf5::Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), "make a property list"));
  checked(H5Pset_fapl_core(access, kGrowBy, 0), "keep a file in memory");
  return access;
}

// Throws unless the file stores as many bytes as extent and type of the dataset declare. Otherwise a damaged extent
// could exhaust the memory.
void check_room(hid_t dataset, const std::string& name) {
  const std::size_t size = H5Tget_size(hdf5::type_of(dataset));
  if (size == 0 || hdf5::count_of(dataset) > H5Dget_storage_size(dataset) / size)
    throw hdf5::Error("find all of dataset " + name);
}

// Returns the text of an attribute or a dataset, which has no room for another number of values.
std::string one_text(hid_t values, const std::string& name) {
  if (!hdf5::is_one_text(values) || H5Tis_variable_str(hdf5::type_of(values)) != 0)
    throw hdf5::Error("read one text from " + name);
  return hdf5::texts_of(values).front();
}

}  // namespace

hdf5::File new_image() {
  const hdf5::Properties access = in_memory();
  return hdf5::File(checked(H5Fcreate(kImageName, H5F_ACC_TRUNC, H5P_DEFAULT, access), "make a file in memory"));
}

hdf5::File open_image(std::span<const std::byte> image) {
  const hdf5::Properties access = in_memory();
  // The cast is safe: H5Pset_file_image only copies the bytes, although its parameter is not const.
  checked(H5Pset_file_image(access, const_cast<std::byte*>(image.data()), image.size()), "take a file image");
  return hdf5::File(checked(H5Fopen(kImageName, H5F_ACC_RDONLY, access), "open a file image"));
}

std::vector<std::byte> bytes_of_image(hid_t file) {
  checked(H5Fflush(file, H5F_SCOPE_GLOBAL), "flush a file in memory");
  const ssize_t size = checked(H5Fget_file_image(file, nullptr, 0), "size a file image");
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  if (H5Fget_file_image(file, bytes.data(), bytes.size()) != size) throw hdf5::Error("give a file image");
  return bytes;
}

void put_text_dataset(hid_t group, const std::string& name, const std::string& text) {
  const hdf5::Type type = hdf5::text_type(std::max<std::size_t>(text.size(), 1));
  hdf5::write(hdf5::make_dataset(group, name, type, {}), type, text.c_str());
}

std::string text_in_dataset(hid_t group, const std::string& name) {
  const hdf5::Dataset dataset = hdf5::open_dataset(group, name);
  check_room(dataset, name);
  return one_text(dataset, name);
}

void put_number(hid_t object, const std::string& name, std::uint64_t value) {
  hdf5::put_attribute(object, name, H5T_STD_U64LE, &value);
}

std::string text_of(hid_t object, const std::string& name) {
  return one_text(hdf5::open_attribute(object, name), name);
}

std::uint64_t number_of(hid_t object, const std::string& name) {
  const hdf5::Attribute attribute = hdf5::open_attribute(object, name);
  if (hdf5::count_of(attribute) != 1) throw hdf5::Error("read one value from " + name);
  std::uint64_t value = 0;
  hdf5::read(attribute, H5T_NATIVE_UINT64, &value);
  return value;
}

Numbers open_numbers(hid_t group, const std::string& name, hid_t type) {
  hdf5::Dataset dataset = hdf5::open_dataset(group, name);
  if (H5Tequal(hdf5::type_of(dataset), type) <= 0)
    throw hdf5::Error("read dataset " + name + " as numbers of the type expected");
  const hdf5::Shape shape = hdf5::shape_of(dataset);
  if (shape.empty() || shape.size() > 2) throw hdf5::Error("read dataset " + name + " as a list or table");
  check_room(dataset, name);
  // A width of 0 is reserved for lists, which have rank 1.
  if (shape.back() == 0 && shape.size() == 2) throw hdf5::Error("find columns in table " + name);
  return {std::move(dataset), shape.front(), shape.size() == 2 ? shape.back() : 0};
}

}  // namespace shearbus::store
