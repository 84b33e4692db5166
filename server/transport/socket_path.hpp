// The path of an ipc socket in the file system: a directory that other users cannot enter, and a lock held by the
// listening server.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "proto/wire/handle.hpp"

namespace shearbus::transport {

// If a second server binds a path in use, libzmq unlinks the path and so disconnects the first server. Therefore a lock
// is acquired before the bind and held as long as the socket exists.
class SocketPath {
 public:
  // Creates the directory (mode 0700) if it does not exist. An existing directory must not be writable for other users
  // and, if `private_to_owner`, they must not be able to enter it. Throws std::runtime_error with the expected state,
  // the state found and a remedy.
  SocketPath(const std::string& path, bool private_to_owner);
  SocketPath(SocketPath&&) noexcept = default;
  ~SocketPath();

  // Lets these users connect to the socket, which exists, in addition to its owner. Returns false if the file system
  // has no access lists; then every user can connect. Throws std::runtime_error on other faults.
  bool admit(std::vector<std::uint32_t> users) const;

  void remember();      // the socket has been made
  bool stands() const;  // whether the file at the path is still that of the socket
  // Prepares to make the socket again: as the constructor does, for a path whose socket, lock or directory is gone.
  void take_again(bool private_to_owner);

 private:
  std::string path_;
  wire::Descriptor lock_;
  dev_t device_ = 0;  // of the socket's file, and its number there; 0: not known
  ino_t inode_ = 0;
};

}  // namespace shearbus::transport
