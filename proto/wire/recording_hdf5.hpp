// HDF5 handles that close themselves, HDF5 errors as one line, files that are whole or not there. Private to the
// sources that write and read HDF5.
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <hdf5.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "proto/wire/status.hpp"

namespace shearbus::wire::hdf5 {

template <herr_t (*kClose)(hid_t)>
class Handle {
 public:
  Handle() = default;
  explicit Handle(hid_t id) : id_(id) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  ~Handle() { close(); }

  operator hid_t() const { return id_; }
  herr_t close() { return id_ >= 0 ? kClose(std::exchange(id_, H5I_INVALID_HID)) : 0; }

 private:
  hid_t id_ = H5I_INVALID_HID;
};

using File = Handle<H5Fclose>;
using Group = Handle<H5Gclose>;
using Dataset = Handle<H5Dclose>;
using Space = Handle<H5Sclose>;
using Type = Handle<H5Tclose>;
using Attribute = Handle<H5Aclose>;
using Properties = Handle<H5Pclose>;
using Object = Handle<H5Oclose>;

// While it lives HDF5 keeps its error stack to itself instead of printing it.
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

// The innermost entry of HDF5's error stack: the one that says what happened rather than who noticed.
inline std::string reason() {
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

[[noreturn]] inline void refuse(const std::filesystem::path& file, const std::string& what,
                                const std::string& remedy = {}, const std::string& dataset = {}) {
  throw Error({.code = Code::kInvalidValue,
               .text = fmt::format("{}: {}", file.string(), what),
               .remedy = remedy,
               .field = dataset});
}

// Passes on what HDF5 returned; a negative value becomes an Error.
template <typename T>
T checked(T returned, const std::filesystem::path& file, const char* what) {
  if (returned < 0) refuse(file, fmt::format("{}: {}", what, reason()));
  return returned;
}

// A new file in the 1.10 format, which checksums its metadata: a flipped bit is an error instead of another number.
// Errors speak of it as `named`.
inline File create_file(const std::filesystem::path& file, const std::filesystem::path& named) {
  const Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), named, "cannot prepare"));
  checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110), named, "cannot ask for the 1.10 format");
  return File(checked(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), named, "cannot create"));
}

// HDF5 issues no fsync of its own, on flush or on close.
inline void sync_to_disk(const std::filesystem::path& path, const std::filesystem::path& named) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!synced) refuse(named, fmt::format("cannot sync to disk: {}", std::generic_category().message(error)));
}

// A finished file gets its name, which survives a loss of power when this returns.
inline void publish(const std::filesystem::path& partial, const std::filesystem::path& file) {
  sync_to_disk(partial, file);
  std::error_code error;
  std::filesystem::rename(partial, file, error);
  if (error) refuse(file, fmt::format("cannot give the finished file its name: {}", error.message()));
  const std::filesystem::path directory = file.parent_path();
  sync_to_disk(directory.empty() ? std::filesystem::path(".") : directory, file);
}

}  // namespace shearbus::wire::hdf5
