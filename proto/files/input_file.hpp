// Files that programs read. A pipe could keep a program waiting and a device has no end: neither is read.
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::files {

// A regular file that is open for reading. Throws Error for any other.
class RegularFile {
 public:
  explicit RegularFile(const std::filesystem::path& file)
      : descriptor_(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {
    struct stat found {};
    if (descriptor_ < 0 || ::fstat(descriptor_, &found) != 0)
      refuse(file, fmt::format("cannot be opened: {}", std::generic_category().message(errno)));
    size_ = static_cast<std::uintmax_t>(found.st_size);
    if (S_ISREG(found.st_mode)) return;
    refuse(file, fmt::format("is {}, expected a regular file", S_ISDIR(found.st_mode)    ? "a directory"
                                                               : S_ISFIFO(found.st_mode) ? "a pipe"
                                                                                         : "a device or a socket"));
  }
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;
  ~RegularFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }

  std::uintmax_t size() const { return size_; }
  // Reads on, up to `most` bytes, into `to`. Returns the number of bytes; 0 at the end. Throws Error.
  std::size_t read(char* to, std::size_t most, const std::filesystem::path& file) const {
    for (;;) {
      const ssize_t taken = ::read(descriptor_, to, most);
      if (taken >= 0) return static_cast<std::size_t>(taken);
      if (errno != EINTR) refuse(file, fmt::format("cannot be read: {}", std::generic_category().message(errno)));
    }
  }

 private:
  static constexpr std::size_t kLongestName = 4096;  // of a file, in messages

  [[noreturn]] void refuse(const std::filesystem::path& file, const std::string& what) {
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
    throw_fault(file, what);
  }
  [[noreturn]] void refuse(const std::filesystem::path& file, const std::string& what) const {
    throw_fault(file, what);
  }
  [[noreturn]] static void throw_fault(const std::filesystem::path& file, const std::string& what) {
    throw wire::Error({.code = wire::Code::kInvalidValue,
                       .text = fmt::format("{}: {}", wire::printable(file.string(), kLongestName), what)});
  }

  int descriptor_;
  std::uintmax_t size_ = 0;
};

}  // namespace shearbus::files
