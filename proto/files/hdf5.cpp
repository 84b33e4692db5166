#include "proto/files/hdf5.hpp"

#include <algorithm>

namespace shearbus::hdf5 {
namespace {

bool is_attribute(hid_t values) {
  return H5Iget_type(values) == H5I_ATTR;
}

// "/meta", or "attribute units of /pressure".
std::string name_of(hid_t values) {
  const auto text = [](const auto& name_into) {
    std::string name(static_cast<std::size_t>(std::max<ssize_t>(name_into(nullptr, 0), 0)), '\0');
    name_into(name.data(), name.size() + 1);
    return name;
  };
  std::string path = text([&](char* out, std::size_t size) { return H5Iget_name(values, out, size); });
  if (!is_attribute(values)) return path;
  return "attribute " + text([&](char* out, std::size_t size) { return H5Aget_name(values, size, out); }) + " of " +
         path;
}

[[noreturn]] void fail_at(hid_t values, const char* doing) {
  const std::string why = reason();  // naming the object begins a new error stack
  throw Error(doing + name_of(values) + ": " + why);
}

// Selects the rows in the file; returns their shape in memory.
Space select_rows(hid_t dataset, hid_t space, std::size_t first, const Shape& rows) {
  Shape start(rows.size(), 0);
  start.front() = first;
  if (H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, rows.data(), nullptr) < 0)
    fail_at(dataset, "select rows of ");
  return Space(checked(H5Screate_simple(static_cast<int>(rows.size()), rows.data(), nullptr), "make a space"));
}

}  // namespace

std::string reason() {
  std::string text;
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned depth, const H5E_error2_t* entry, void* out) -> herr_t {
        if (depth == 0 && entry->desc) *static_cast<std::string*>(out) = entry->desc;
        return 0;
      },
      &text);
  return text.empty() ? "HDF5 gives no reason" : text;
}

void fail(std::string_view doing, std::string_view what) {
  throw Error(std::string(doing).append(what).append(": ").append(reason()));
}

Group make_group(hid_t parent, const std::string& name) {
  return Group(checked(H5Gcreate2(parent, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "make group ", name));
}

Group open_group(hid_t parent, const std::string& name) {
  return Group(checked(H5Gopen2(parent, name.c_str(), H5P_DEFAULT), "find group ", name));
}

std::vector<std::string> children_of(hid_t group) {
  std::vector<std::string> names;
  const auto add = [](hid_t, const char* name, const H5L_info_t*, void* into) -> herr_t {
    static_cast<std::vector<std::string>*>(into)->emplace_back(name);
    return 0;
  };
  checked(H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names), "list a group");
  return names;
}

bool has_child(hid_t parent, const std::string& name) {
  return checked(H5Lexists(parent, name.c_str(), H5P_DEFAULT), "look for ", name) > 0;
}

bool has_attribute(hid_t object, const std::string& name) {
  return checked(H5Aexists(object, name.c_str()), "look for ", name) > 0;
}

Type text_type(std::size_t size) {
  Type type(checked(H5Tcopy(H5T_C_S1), "make a text type"));
  checked(H5Tset_size(type, size), "size a text type");
  checked(H5Tset_cset(type, H5T_CSET_UTF8), "make a text type UTF-8");
  checked(H5Tset_strpad(type, H5T_STR_NULLPAD), "make a text type");
  return type;
}

void put_attribute(hid_t object, const std::string& name, hid_t type, const void* value) {
  const Space space(checked(H5Screate(H5S_SCALAR), "make a space"));
  const Attribute attribute(
      checked(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), "make attribute ", name));
  write(attribute, type, value);
}

void put_text(hid_t object, const std::string& name, const std::string& text) {
  put_attribute(object, name, text_type(std::max<std::size_t>(text.size(), 1)), text.c_str());
}

Attribute open_attribute(hid_t object, const std::string& name) {
  return Attribute(checked(H5Aopen(object, name.c_str(), H5P_DEFAULT), "find attribute ", name));
}

Dataset make_dataset(hid_t parent, const std::string& name, hid_t type, const Shape& shape, hid_t creation,
                     const Shape& most) {
  const Space space(checked(shape.empty() ? H5Screate(H5S_SCALAR)
                                          : H5Screate_simple(static_cast<int>(shape.size()), shape.data(),
                                                             most.empty() ? nullptr : most.data()),
                            "make a space for ", name));
  Properties link;
  if (name.find('/') != std::string::npos) {
    link = Properties(checked(H5Pcreate(H5P_LINK_CREATE), "make a property list"));
    checked(H5Pset_create_intermediate_group(link, 1), "make groups for ", name);
  }
  return Dataset(checked(
      H5Dcreate2(parent, name.c_str(), type, space, link < 0 ? H5P_DEFAULT : hid_t{link}, creation, H5P_DEFAULT),
      "make dataset ", name));
}

Dataset open_dataset(hid_t parent, const std::string& name) {
  return Dataset(checked(H5Dopen2(parent, name.c_str(), H5P_DEFAULT), "find dataset ", name));
}

Properties creation_of(hid_t dataset) {
  return Properties(checked(H5Dget_create_plist(dataset), "read how a dataset was made"));
}

Type type_of(hid_t values) {
  return Type(checked(is_attribute(values) ? H5Aget_type(values) : H5Dget_type(values), "read a type"));
}

Space space_of(hid_t values) {
  return Space(checked(is_attribute(values) ? H5Aget_space(values) : H5Dget_space(values), "read a size"));
}

Shape shape_of(hid_t values) {
  const Space space = space_of(values);
  if (H5Sget_simple_extent_type(space) == H5S_NULL) return {0};
  Shape shape(static_cast<std::size_t>(checked(H5Sget_simple_extent_ndims(space), "read a size")));
  if (!shape.empty()) checked(H5Sget_simple_extent_dims(space, shape.data(), nullptr), "read a size");
  return shape;
}

std::size_t count_of(hid_t values) {
  return static_cast<std::size_t>(checked(H5Sget_simple_extent_npoints(space_of(values)), "read a size"));
}

void read(hid_t values, hid_t memory_type, void* out) {
  if ((is_attribute(values) ? H5Aread(values, memory_type, out)
                            : H5Dread(values, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, out)) < 0)
    fail_at(values, "read ");
}

void write(hid_t values, hid_t memory_type, const void* in) {
  if ((is_attribute(values) ? H5Awrite(values, memory_type, in)
                            : H5Dwrite(values, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, in)) < 0)
    fail_at(values, "write ");
}

void read_rows(hid_t dataset, hid_t memory_type, std::size_t first, const Shape& rows, void* out) {
  const Space space = space_of(dataset);
  const Space memory = select_rows(dataset, space, first, rows);
  if (H5Dread(dataset, memory_type, memory, space, H5P_DEFAULT, out) < 0) fail_at(dataset, "read rows of ");
}

void write_rows(hid_t dataset, hid_t memory_type, std::size_t first, const Shape& rows, const void* in) {
  const Space space = space_of(dataset);
  const Space memory = select_rows(dataset, space, first, rows);
  if (H5Dwrite(dataset, memory_type, memory, space, H5P_DEFAULT, in) < 0) fail_at(dataset, "write rows of ");
}

bool is_one_text(hid_t values) {
  return H5Tget_class(type_of(values)) == H5T_STRING && H5Sget_simple_extent_npoints(space_of(values)) == 1;
}

std::vector<std::string> texts_of(hid_t values) {
  const Type type = type_of(values);
  const std::size_t count = count_of(values);
  std::vector<std::string> texts;
  texts.reserve(count);
  if (H5Tis_variable_str(type) > 0) {
    std::vector<char*> found(count, nullptr);
    read(values, type, static_cast<void*>(found.data()));
    for (const char* text : found) texts.emplace_back(text != nullptr ? text : "");
    H5Dvlen_reclaim(type, space_of(values), H5P_DEFAULT, static_cast<void*>(found.data()));
    return texts;
  }
  const std::size_t width = H5Tget_size(type);
  std::string found(count * width, '\0');
  read(values, type, found.data());
  for (std::size_t i = 0; i < count; ++i) {
    const std::string_view cell = std::string_view(found).substr(i * width, width);
    texts.emplace_back(cell.substr(0, cell.find('\0')));
  }
  return texts;
}

}  // namespace shearbus::hdf5
