// The path of an ipc socket in the file system: a directory that other users cannot enter, and a lock held by the
// listening server.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace shearbus::transport {

// libzmq unlinks a path in use and binds it again, which disconnects the first server. Therefore the lock is acquired
// before the bind and held as long as the socket exists.
class SocketPath {
 public:
  // Creates the directory (mode 0700) if it does not exist. `private_to_owner`: other users must not be able to enter
  // it; otherwise they must not be able to write to it. Throws std::runtime_error with the expected state, the state
  // found and a remedy.
  SocketPath(const std::string& path, bool private_to_owner);
  SocketPath(SocketPath&& other) noexcept;
  SocketPath& operator=(SocketPath&& other) noexcept;
  ~SocketPath();

  // Lets these users connect to the socket, which exists, in addition to its owner. Returns false if the file system
  // has no access lists; then every user can connect. Throws std::runtime_error on other faults.
  bool admit(std::vector<std::uint32_t> users) const;

 private:
  std::string path_;
  int lock_ = -1;
};

}  // namespace shearbus::transport
