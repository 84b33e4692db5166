#include "server/store/posix_storage.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "proto/files/record_file.hpp"
#include "proto/wire/host_process.hpp"

namespace shearbus::store {
namespace {

constexpr const char* kLockName = "lock";

class PosixFile final : public File {
 public:
  PosixFile(wire::Descriptor file, std::string name) : file_(std::move(file)), name_(std::move(name)) {}

  void append(std::span<const Bytes> parts) override {
    if (const int fault = files::write_parts(file_, parts)) throw StorageError("cannot write " + name_, fault);
  }
  void overwrite(std::uint64_t offset, Bytes bytes) override {
    const auto written =
        wire::uninterrupted([&] { return ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset)); });
    if (written != static_cast<ssize_t>(bytes.size()))
      throw StorageError("cannot write " + name_, written < 0 ? errno : EIO);
  }
  void truncate(std::uint64_t size) override {
    const auto end = static_cast<off_t>(size);
    if (wire::uninterrupted([&] { return ::ftruncate(file_, end); }) < 0 || ::lseek(file_, end, SEEK_SET) < 0)
      throw StorageError("cannot shorten " + name_, errno);
  }
  void sync() override {
    // A failed fsync is never retried: the kernel may have marked the lost pages as clean.
    if (::fdatasync(file_) < 0) throw StorageError("cannot bring " + name_ + " to the disk", errno);
  }

 private:
  wire::Descriptor file_;
  std::string name_;
};

}  // namespace

StorageError::StorageError(const std::string& doing, int code)
    : std::runtime_error(doing + ": " + std::generic_category().message(code) +
                         (code == EROFS || code == EACCES || code == EPERM
                              ? "; choose a state directory in which the server's user may write"
                              : "")),
      code_(code) {}

PosixStorage::PosixStorage(const std::filesystem::path& directory) : path_(directory) {
  if (::mkdir(path_.c_str(), 0700) < 0 && errno != EEXIST)
    throw StorageError("cannot make the state directory " + path_.string(), errno);
  directory_ = wire::Descriptor(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory_ < 0) throw StorageError("cannot open the state directory " + path_.string(), errno);
  struct stat found {};
  if (::fstat(directory_, &found) < 0 || found.st_uid != ::geteuid() || (found.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    throw std::runtime_error(
        "the state directory " + path_.string() +
        " must belong to the user of the server and be writable by nobody else: chmod go-w, or choose another");
  // A file system that locks no directories, such as NFS, gives another error: there only the lock file keeps others
  // out.
  if (::flock(directory_, LOCK_EX | LOCK_NB) < 0 && errno == EWOULDBLOCK) refuse_held();
  hold_lock();
}

// A process that the host has forked has these files open, too, and would keep their locks.
PosixStorage::~PosixStorage() {
  static_cast<void>(::flock(lock_, LOCK_UN));
  static_cast<void>(::flock(directory_, LOCK_UN));
}

void PosixStorage::refuse_held() const {
  throw StorageError(
      "another server holds the state directory " + path_.string() +
          ", or a process that a host with a server inside has forked; stop it first, or choose another directory",
      EBUSY);
}

// Locks the file `lock` of the directory. Does nothing if this server holds the lock and nobody replaced the file.
void PosixStorage::hold_lock() {
  struct stat held {
  }, named{};
  if (lock_ >= 0 && ::fstat(lock_, &held) == 0 && ::fstatat(directory_, kLockName, &named, AT_SYMLINK_NOFOLLOW) == 0 &&
      held.st_dev == named.st_dev && held.st_ino == named.st_ino)
    return;
  wire::Descriptor file(::openat(directory_, kLockName, O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file < 0 || ::flock(file, LOCK_EX | LOCK_NB) < 0) {
    if (errno == EWOULDBLOCK) refuse_held();
    throw StorageError("cannot lock the state directory " + path_.string(), errno);
  }
  lock_ = std::move(file);
}

std::string PosixStorage::shown(const std::string& name) const {
  return (path_ / name).string();
}

std::vector<std::string> PosixStorage::list() {
  const int file = ::openat(directory_, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  DIR* stream = file < 0 ? nullptr : ::fdopendir(file);
  if (stream == nullptr) throw StorageError("cannot read the state directory " + path_.string(), errno);
  std::vector<std::string> names;
  errno = 0;
  while (const dirent* entry = ::readdir(stream)) {
    if (std::strcmp(entry->d_name, ".") != 0 && std::strcmp(entry->d_name, "..") != 0 &&
        std::strcmp(entry->d_name, kLockName) != 0)
      names.emplace_back(entry->d_name);
    errno = 0;
  }
  const int fault = errno;
  ::closedir(stream);
  if (fault != 0) throw StorageError("cannot read the state directory " + path_.string(), fault);
  return names;
}

std::vector<std::byte> PosixStorage::read(const std::string& name) {
  // Without O_NONBLOCK the call would wait for the writer of a pipe of that name.
  const wire::Descriptor file(::openat(directory_, name.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (file < 0) throw StorageError("cannot open " + shown(name), errno);
  struct stat found {};
  std::vector<std::byte> bytes;
  std::size_t size = 0;
  ssize_t taken = ::fstat(file, &found);
  if (taken == 0 && !S_ISREG(found.st_mode))
    throw StorageError("cannot read " + shown(name) + ", which is no regular file", EINVAL);
  if (taken == 0) {
    bytes.resize(static_cast<std::size_t>(found.st_size));
    while (size < bytes.size() &&
           (taken = wire::uninterrupted([&] { return ::read(file, bytes.data() + size, bytes.size() - size); })) > 0)
      size += static_cast<std::size_t>(taken);
  }
  if (taken < 0) throw StorageError("cannot read " + shown(name), errno);
  bytes.resize(size);
  return bytes;
}

std::unique_ptr<File> PosixStorage::create(const std::string& name) {
  {
    const std::lock_guard holding(holding_);
    hold_lock();
  }
  wire::Descriptor file(::openat(directory_, name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file < 0) throw StorageError("cannot make " + shown(name), errno);
  return std::make_unique<PosixFile>(std::move(file), shown(name));
}

void PosixStorage::rename(const std::string& from, const std::string& to) {
  if (::renameat(directory_, from.c_str(), directory_, to.c_str()) < 0)
    throw StorageError("cannot rename " + shown(from) + " to " + to, errno);
}

void PosixStorage::remove(const std::string& name) {
  if (::unlinkat(directory_, name.c_str(), 0) < 0) throw StorageError("cannot remove " + shown(name), errno);
}

void PosixStorage::sync(const std::string& name) {
  const wire::Descriptor file(::openat(directory_, name.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
  if (file < 0) throw StorageError("cannot open " + shown(name), errno);
  if (::fdatasync(file) < 0) throw StorageError("cannot bring " + shown(name) + " to the disk", errno);
}

void PosixStorage::sync_directory() {
  if (::fsync(directory_) < 0)
    throw StorageError("cannot bring the state directory " + path_.string() + " to the disk", errno);
}

}  // namespace shearbus::store
