#include "proto/files/output_driver.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <map>
#include <memory>
#include <vector>

#include "proto/wire/handle.hpp"

namespace shearbus::files::hdf5 {
namespace {

thread_local int last_fault = 0;

// A file that is open with this driver. HDF5 uses the first member, the driver the others.
struct OutputFile {
  H5FD_t base{};
  wire::Descriptor number;
  haddr_t end_of_allocation = 0;
  haddr_t end = 0;
  int fault = 0;
  // bytes that could not be written after a fault, by their place in the file; reads still return them
  std::map<haddr_t, std::vector<char>> held;
};

OutputFile& self(H5FD_t* file) {
  return *reinterpret_cast<OutputFile*>(file);
}
const OutputFile& self(const H5FD_t* file) {
  return *reinterpret_cast<const OutputFile*>(file);
}

H5FD_t* open_file(const char* name, unsigned flags, hid_t, haddr_t) {
  const int how = ((flags & H5F_ACC_RDWR) != 0 ? O_RDWR : O_RDONLY) | ((flags & H5F_ACC_CREAT) != 0 ? O_CREAT : 0) |
                  ((flags & H5F_ACC_TRUNC) != 0 ? O_TRUNC : 0) | ((flags & H5F_ACC_EXCL) != 0 ? O_EXCL : 0) |
                  O_CLOEXEC | O_NOFOLLOW;
  auto file = std::make_unique<OutputFile>();
  file->number = wire::Descriptor(::open(name, how, 0666));
  struct stat found {};
  last_fault = file->number < 0 || ::fstat(file->number, &found) != 0 ? errno : 0;
  if (last_fault != 0) return nullptr;
  file->end = static_cast<haddr_t>(found.st_size);
  return &file.release()->base;
}

herr_t close_file(H5FD_t* file) {
  last_fault = self(file).fault;
  delete &self(file);
  return 0;
}

herr_t query(const H5FD_t*, unsigned long* flags) {
  *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
           H5FD_FEAT_AGGREGATE_SMALLDATA;
  return 0;
}

haddr_t end_of_allocation(const H5FD_t* file, H5FD_mem_t) {
  return self(file).end_of_allocation;
}
herr_t set_end_of_allocation(H5FD_t* file, H5FD_mem_t, haddr_t end) {
  self(file).end_of_allocation = end;
  return 0;
}
haddr_t end_of_file(const H5FD_t* file, H5FD_mem_t) {
  return self(file).end;
}
herr_t handle_of(H5FD_t* file, hid_t, void** handle) {
  *handle = &self(file).fault;
  return 0;
}

herr_t read_file(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t at, std::size_t size, void* buffer) {
  OutputFile& file = self(base);
  char* const out = static_cast<char*>(buffer);
  std::memset(out, 0, size);  // bytes behind the end of the file read as zeros
  for (std::size_t done = 0; done < size;) {
    const ssize_t taken = ::pread(file.number, out + done, size - done, static_cast<off_t>(at + done));
    if (taken < 0 && errno == EINTR) continue;
    if (taken < 0 && file.fault == 0) file.fault = errno;
    if (taken <= 0) break;
    done += static_cast<std::size_t>(taken);
  }
  for (const auto& [begin, bytes] : file.held) {
    const haddr_t first = std::max(begin, at);
    const haddr_t last = std::min(begin + bytes.size(), at + size);
    if (first < last) std::memcpy(out + (first - at), bytes.data() + (first - begin), last - first);
  }
  return 0;
}

herr_t write_file(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t at, std::size_t size, const void* buffer) {
  OutputFile& file = self(base);
  const char* const bytes = static_cast<const char*>(buffer);
  for (std::size_t done = 0; done < size && file.fault == 0;) {
    const ssize_t written = ::pwrite(file.number, bytes + done, size - done, static_cast<off_t>(at + done));
    if (written < 0 && errno != EINTR) file.fault = errno;
    if (written > 0) done += static_cast<std::size_t>(written);
  }
  if (file.fault != 0) {
    std::vector<char>& held = file.held[at];
    if (held.size() < size) held.resize(size);
    std::memcpy(held.data(), bytes, size);
  }
  file.end = std::max(file.end, at + size);
  return 0;
}

herr_t truncate_file(H5FD_t* base, hid_t, hbool_t) {
  OutputFile& file = self(base);
  if (file.end == file.end_of_allocation) return 0;
  if (file.fault == 0 && ::ftruncate(file.number, static_cast<off_t>(file.end_of_allocation)) != 0) file.fault = errno;
  file.end = file.end_of_allocation;
  return 0;
}

hid_t driver() {
  static const H5FD_class_t made = [] {
    H5FD_class_t c{};
    c.name = "shearbus output";
    c.maxaddr = static_cast<haddr_t>(INT64_MAX);
    c.fc_degree = H5F_CLOSE_WEAK;
    c.open = open_file;
    c.close = close_file;
    c.query = query;
    c.get_eoa = end_of_allocation;
    c.set_eoa = set_end_of_allocation;
    c.get_eof = end_of_file;
    c.get_handle = handle_of;
    c.read = read_file;
    c.write = write_file;
    c.truncate = truncate_file;
    constexpr H5FD_mem_t kFreeLists[] = H5FD_FLMAP_DICHOTOMY;  // the same as in HDF5's own driver
    std::copy(std::begin(kFreeLists), std::end(kFreeLists), std::begin(c.fl_map));
    return c;
  }();
  static const hid_t id = H5FDregister(&made);
  return id;
}

}  // namespace

herr_t use_output_driver(hid_t access) {
  return H5Pset_driver(access, driver(), nullptr);
}

int fault_of(hid_t file) {
  void* fault = nullptr;
  return H5Fget_vfd_handle(file, H5P_DEFAULT, &fault) < 0 || fault == nullptr ? EIO : *static_cast<const int*>(fault);
}

int fault_of_last_file() {
  return last_fault;
}

}  // namespace shearbus::files::hdf5
