// The disk as the store uses it: one flat directory of files that grow. It is an interface so that tests can
// substitute a disk that fails or loses power at any call.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace shearbus::store {

using Bytes = std::span<const std::byte>;

// Thrown if a call of the disk fails.
class StorageError : public std::runtime_error {
 public:
  StorageError(const std::string& doing, int code);
  int code() const { return code_; }  // errno of the failed call
  // True if there is no room on the disk, in the quota, or below the largest size that a file may have.
  bool no_space() const { return code_ == ENOSPC || code_ == EDQUOT || code_ == EFBIG; }

 private:
  int code_;
};

// An open file, which is appended to.
class File {
 public:
  virtual ~File() = default;
  // Appends all parts in order. If it throws, any prefix of the bytes may have been written.
  virtual void append(std::span<const Bytes> parts) = 0;
  // Replaces bytes at `offset`, all of which have been written before.
  virtual void overwrite(std::uint64_t offset, Bytes bytes) = 0;
  virtual void truncate(std::uint64_t size) = 0;
  // After the call the written bytes survive a loss of power. Calling again after a failure does not help: bytes
  // written before the failure may be lost even if the second call succeeds.
  virtual void sync() = 0;
};

class Storage {
 public:
  virtual ~Storage() = default;
  virtual std::vector<std::string> list() = 0;                              // names, in any order
  virtual std::vector<std::byte> read(const std::string& name) = 0;         // the whole content
  virtual std::unique_ptr<File> create(const std::string& name) = 0;        // fails if the name exists
  virtual void rename(const std::string& from, const std::string& to) = 0;  // replaces an existing `to`
  virtual void remove(const std::string& name) = 0;
  virtual void sync(const std::string& name) = 0;  // brings the content to the disk
  virtual void sync_directory() = 0;               // after the call the names survive a loss of power
};

// Removes a file that its writer could not finish. A file that cannot be removed stays.
inline void discard(Storage& storage, const std::string& name) {
  try {
    storage.remove(name);
  } catch (const StorageError&) {
    // The caller reports the fault that came first.
  }
}

}  // namespace shearbus::store
