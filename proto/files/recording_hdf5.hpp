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

// Returns what `body` returns; what HDF5 cannot do in it is reported with the file.
template <typename Body>
decltype(auto) in_file(const std::filesystem::path& file, const std::string& remedy, const Body& body) {
  const Quiet quiet;
  try {
    return body();
  } catch (const Error& fault) {
    refuse_file(file, fault.what(), remedy);
  }
}
template <typename Body>
decltype(auto) in_file(const std::filesystem::path& file, const Body& body) {
  return in_file(file, {}, body);
}

// An HDF5 file that is being written, in the 1.10 format, which checksums its metadata: a flipped bit is an error
// instead of another number.
class OutputHdf5 {
 public:
  OutputHdf5(const std::filesystem::path& file, const FileKind& kind, mode_t mode = 0666)
      : partial_(file, kind, PartialFile::Writers::kOne, mode),
        handle_(in_file(partial_.file(), [&] { return made(); })) {}

  operator hid_t() const { return handle_; }
  const std::filesystem::path& file() const { return partial_.file(); }  // the final name
  bool replaces() const { return partial_.replaces(); }
  herr_t abandon() { return handle_.close(); }

  // Throws if a write to the open file has failed. HDF5 itself reports no failed write (output_driver.hpp).
  void check_written() const {
    if (const int fault = fault_of(handle_)) refuse_to_write(file(), fault);
  }

  // Closes the file, all of whose objects are closed, and gives it its name if every byte was written.
  void close_and_publish() {
    checked(H5Fflush(handle_, H5F_SCOPE_LOCAL), "write to the disk");
    check_written();
    checked(handle_.close(), "close the file");
    if (const int fault = fault_of_last_file()) refuse_to_write(file(), fault);
    partial_.publish();
  }

 private:
  File made() const {
    const Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), "make a property list"));
    checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110), "write the 1.10 format");
    checked(use_output_driver(access), "use the driver of output files");
    File created(H5Fcreate(partial_.path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access));
    if (created < 0 && fault_of_last_file() != 0) refuse_to_write(file(), fault_of_last_file());
    checked(hid_t{created}, "make the file");
    return created;
  }

  PartialFile partial_;
  File handle_;
};

}  // namespace shearbus::files::hdf5
