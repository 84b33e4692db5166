// Storage in a directory of the file system, locked by one process at a time.
#pragma once

#include <filesystem>
#include <mutex>

#include "proto/wire/handle.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

class PosixStorage final : public Storage {
 public:
  // Creates the directory (mode 0700) if it does not exist, and locks it: the directory itself and, for file systems
  // that lock no directories, the file `lock` in it. Throws std::runtime_error if another process holds a lock, or if
  // another user owns the directory or can write to it: write access to the directory is control over the states.
  explicit PosixStorage(const std::filesystem::path& directory);
  ~PosixStorage() override;

  std::vector<std::string> list() override;
  std::vector<std::byte> read(const std::string& name) override;
  // If somebody has removed the lock file, makes and locks a new one; throws if another process has done so already.
  std::unique_ptr<File> create(const std::string& name) override;
  void rename(const std::string& from, const std::string& to) override;
  void remove(const std::string& name) override;
  void sync(const std::string& name) override;
  void sync_directory() override;

 private:
  [[noreturn]] void refuse_held() const;
  void hold_lock();
  std::string shown(const std::string& name) const;  // path of a file of the directory, for messages

  std::filesystem::path path_;
  wire::Descriptor directory_, lock_;
  std::mutex holding_;  // a checkpoint may be written by another thread
};

}  // namespace shearbus::store
