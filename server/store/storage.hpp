// The few things the store asks of a disk: one flat directory of append-only files. An interface, so that tests can put
// a disk in its place that fails or dies at any call.
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

// A call of the disk that failed.
class StorageError : public std::runtime_error {
 public:
  StorageError(const std::string& doing, int code);
  int code() const { return code_; }  // errno
  bool no_space() const { return code_ == ENOSPC || code_ == EDQUOT; }

 private:
  int code_;
};

// An open file; it grows at its end only.
class File {
 public:
  virtual ~File() = default;
  // All of the parts, one after the other. Where it throws, any part of them may have been written.
  virtual void append(std::span<const Bytes> parts) = 0;
  virtual void truncate(std::uint64_t size) = 0;
  // What was written survives the loss of power from here on. A failure is final: what was written before may be gone,
  // and the next call may succeed all the same.
  virtual void sync() = 0;
};

class Storage {
 public:
  virtual ~Storage() = default;
  virtual std::vector<std::string> list() = 0;                              // names, in no order
  virtual std::vector<std::byte> read(const std::string& name) = 0;         // all of it
  virtual std::unique_ptr<File> create(const std::string& name) = 0;        // fails where the name exists
  virtual std::unique_ptr<File> open(const std::string& name) = 0;          // to append; fails where it does not exist
  virtual void rename(const std::string& from, const std::string& to) = 0;  // replaces `to`
  virtual void remove(const std::string& name) = 0;
  virtual void sync_directory() = 0;  // names survive the loss of power
};

}  // namespace shearbus::store
