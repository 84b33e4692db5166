// Writes files that get their name only when they are complete and on the disk.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>

#include "proto/wire/status.hpp"

namespace shearbus::wire {

// Throws Error for a file that cannot be written; `fault` is an errno.
[[noreturn]] inline void refuse_to_write(const std::filesystem::path& file, int fault) {
  const bool no_space = fault == ENOSPC || fault == EDQUOT || fault == EFBIG;
  throw Error(
      {.code = no_space ? Code::kNoSpace : Code::kInvalidValue,
       .text = file.string() + ": cannot be written: " + std::generic_category().message(fault) + "; no file is left",
       .remedy = no_space ? "Make room there, or write elsewhere." : ""});
}

inline void sync_to_disk(const std::filesystem::path& path, const std::filesystem::path& named) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int fault = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!synced) refuse_to_write(named, fault);
}

// Gives a finished file its name. When the function has returned, the name survives a loss of power.
inline void publish(const std::filesystem::path& partial, const std::filesystem::path& file) {
  try {
    sync_to_disk(partial, file);
    std::error_code fault;
    std::filesystem::rename(partial, file, fault);
    if (fault) refuse_to_write(file, fault.value());
  } catch (const Error&) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    throw;
  }
  const std::filesystem::path directory = file.parent_path();
  sync_to_disk(directory.empty() ? std::filesystem::path(".") : directory, file);
}

// Writes the text to `file` as a whole; on failure throws Error and leaves no partial file.
inline void write_whole(const std::filesystem::path& file, std::string_view text) {
  std::filesystem::path partial = file;
  partial += ".partial";
  const int descriptor = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  int fault = descriptor < 0 ? errno : 0;
  while (fault == 0 && !text.empty()) {
    const ssize_t written = ::write(descriptor, text.data(), text.size());
    if (written < 0 && errno != EINTR) fault = errno;
    if (written > 0) text.remove_prefix(static_cast<std::size_t>(written));
  }
  if (descriptor >= 0 && ::close(descriptor) != 0 && fault == 0) fault = errno;
  if (fault != 0) {
    if (descriptor >= 0) ::unlink(partial.c_str());
    refuse_to_write(file, fault);
  }
  publish(partial, file);
}

}  // namespace shearbus::wire
