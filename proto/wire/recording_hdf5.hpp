// HDF5 errors as wire::Error, and files that get their name only when they are complete. Private to the sources of this
// directory that write and read HDF5.
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

#include "proto/wire/hdf5.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::wire::hdf5 {

using namespace shearbus::hdf5;  // NOLINT(google-build-using-namespace)

[[noreturn]] inline void refuse(const std::filesystem::path& file, const std::string& what,
                                const std::string& remedy = {}, const std::string& dataset = {}) {
  throw Error({.code = Code::kInvalidValue,
               .text = fmt::format("{}: {}", file.string(), what),
               .remedy = remedy,
               .field = dataset});
}

// Returns the value that HDF5 returned; throws Error for a negative value.
template <typename T>
T checked(T returned, const std::filesystem::path& file, const char* what) {
  if (returned < 0) refuse(file, fmt::format("{}: {}", what, reason()));
  return returned;
}

// A new file in the 1.10 format, which checksums its metadata: a flipped bit is an error instead of another number.
// Errors name the file as `named`.
inline File create_file(const std::filesystem::path& file, const std::filesystem::path& named) {
  const Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), named, "cannot prepare"));
  checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110), named, "cannot ask for the 1.10 format");
  return File(checked(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), named, "cannot create"));
}

// Calls fsync, which HDF5 itself never does, neither on flush nor on close.
inline void sync_to_disk(const std::filesystem::path& path, const std::filesystem::path& named) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!synced) refuse(named, fmt::format("cannot sync to disk: {}", std::generic_category().message(error)));
}

// Gives a finished file its name. The name survives a loss of power when the function has returned.
inline void publish(const std::filesystem::path& partial, const std::filesystem::path& file) {
  sync_to_disk(partial, file);
  std::error_code error;
  std::filesystem::rename(partial, file, error);
  if (error) refuse(file, fmt::format("cannot give the finished file its name: {}", error.message()));
  const std::filesystem::path directory = file.parent_path();
  sync_to_disk(directory.empty() ? std::filesystem::path(".") : directory, file);
}

}  // namespace shearbus::wire::hdf5
