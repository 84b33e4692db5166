// The place of an ipc socket in the file system: a directory nobody else can enter, and a lock that says who listens.
#pragma once

#include <string>

namespace shearbus::transport {

// libzmq would unlink a path in use and take it over, leaving the first server deaf; so the lock is taken before the
// bind and held for as long as the socket is.
class SocketPath {
 public:
  // Makes the directory (mode 0700) where it does not exist. `private_to_owner`: nobody else may enter it; otherwise
  // nobody else may write to it. Throws std::runtime_error: what was expected, what was found, what to do.
  SocketPath(const std::string& path, bool private_to_owner);
  SocketPath(SocketPath&& other) noexcept;
  SocketPath& operator=(SocketPath&& other) noexcept;
  ~SocketPath();

 private:
  std::string path_;
  int lock_ = -1;
};

}  // namespace shearbus::transport
