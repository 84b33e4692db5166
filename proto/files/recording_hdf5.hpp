// Reports HDF5 errors as wire::Error, and gives files their name only when they are complete. Private to the sources of
// this directory that write and read HDF5.
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>

#include "proto/files/hdf5.hpp"
#include "proto/files/output_driver.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::files::hdf5 {

using namespace shearbus::hdf5;  // NOLINT(google-build-using-namespace)

[[noreturn]] inline void refuse(const std::filesystem::path& file, const std::string& what,
                                const std::string& remedy = {}, const std::string& dataset = {}) {
  throw wire::Error({.code = wire::Code::kInvalidValue,
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

// Creates the HDF5 file of a partial file, in the 1.10 format, which checksums its metadata: a flipped bit is an error
// instead of another number. Errors name the final file.
inline File create_file(const PartialFile& partial) {
  const std::filesystem::path& named = partial.file();
  const Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), named, "cannot prepare"));
  checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110), named, "cannot ask for the 1.10 format");
  checked(use_output_driver(access), named, "cannot prepare");
  File made(H5Fcreate(partial.path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access));
  if (made < 0 && fault_of_last_file() != 0) refuse_to_write(named, fault_of_last_file());
  checked(hid_t{made}, named, "cannot create");
  return made;
}

// Throws if a write to the open file has failed. HDF5 itself reports no failed write (output_driver.hpp).
inline void check_written(hid_t file, const std::filesystem::path& named) {
  if (const int fault = fault_of(file)) refuse_to_write(named, fault);
}

// Closes a file, all of whose objects are closed, and gives it its name if every byte was written.
inline void close_and_publish(File& file, PartialFile& partial) {
  const std::filesystem::path& named = partial.file();
  checked(H5Fflush(file, H5F_SCOPE_LOCAL), named, "cannot write to the disk");
  check_written(file, named);
  checked(file.close(), named, "cannot close");
  if (const int fault = fault_of_last_file()) refuse_to_write(named, fault);
  partial.publish();
}

}  // namespace shearbus::files::hdf5
