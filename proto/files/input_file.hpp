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

#include "proto/wire/handle.hpp"
#include "proto/wire/host_process.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::files {

// A regular file that is open for reading. Throws Error for any other.
class RegularFile {
 public:
  explicit RegularFile(std::filesystem::path file)
      : file_(std::move(file)), descriptor_(::open(file_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {
    struct stat found {};
    if (descriptor_ < 0 || ::fstat(descriptor_, &found) != 0) refuse("cannot be opened");
    size_ = static_cast<std::uintmax_t>(found.st_size);
    if (!S_ISREG(found.st_mode))
      refuse(S_ISDIR(found.st_mode)    ? "is a directory, expected a regular file"
             : S_ISFIFO(found.st_mode) ? "is a pipe, expected a regular file"
                                       : "is a device or a socket, expected a regular file",
             0);
  }

  std::uintmax_t size() const { return size_; }
  // Reads on, up to `most` bytes, into `to`. Returns the number of bytes; 0 at the end. Throws Error.
  std::size_t read(char* to, std::size_t most) const {
    const ssize_t taken = wire::uninterrupted([&] { return ::read(descriptor_, to, most); });
    if (taken < 0) refuse("cannot be read");
    return static_cast<std::size_t>(taken);
  }
  // Returns the file, or its first `most` bytes. Throws Error.
  std::string head(std::size_t most) const {
    std::string text(most, '\0');
    std::size_t size = 0;
    while (const std::size_t taken = read(text.data() + size, most - size)) size += taken;
    text.resize(size);
    return text;
  }

 private:
  static constexpr std::size_t kLongestName = 4096;  // of a file, in messages

  [[noreturn]] void refuse(const char* what, int fault = errno) const {
    throw wire::Error(
        {.code = wire::Code::kInvalidValue,
         .text = fmt::format("{}: {}{}{}", wire::printable(file_.string(), kLongestName), what, fault == 0 ? "" : ": ",
                             fault == 0 ? "" : std::generic_category().message(fault))});
  }

  std::filesystem::path file_;
  wire::Descriptor descriptor_;
  std::uintmax_t size_ = 0;
};

}  // namespace shearbus::files
