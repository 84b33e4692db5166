#include "server/transport/socket_path.hpp"

#include <fcntl.h>
#include <linux/posix_acl.h>
#include <linux/posix_acl_xattr.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "proto/wire/host_process.hpp"

namespace shearbus::transport {
namespace {

std::string octal(mode_t mode) {
  std::array<char, 8> text{};
  static_cast<void>(std::snprintf(text.data(), text.size(), "%04o", static_cast<unsigned>(mode & 07777)));
  return text.data();
}

std::string directory_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// A directory for the socket of this user's server.
std::string own_directory() {
  return ::geteuid() == 0 ? "/run/shearbus" : "/run/user/" + std::to_string(::geteuid()) + "/shearbus";
}

// True for a directory whose mode is not to be changed for a socket: one that everybody may use, the root, or the home
// of the user.
bool is_shared(const std::string& directory, mode_t mode) {
  struct stat here {};
  struct stat other {};
  const auto is = [&](const char* path) {
    return path != nullptr && ::stat(path, &other) == 0 && other.st_dev == here.st_dev && other.st_ino == here.st_ino;
  };
  if ((mode & S_ISVTX) != 0 || ::stat(directory.c_str(), &here) != 0) return true;
  return is("/") || is(std::getenv("HOME"));
}

void check_directory(const std::string& path, bool private_to_owner) {
  const std::string directory = directory_of(path);
  const auto refuse = [&](const std::string& what) {
    throw std::runtime_error("cannot listen on ipc://" + path + ": the directory " + directory + " " + what);
  };
  if (::mkdir(directory.c_str(), 0700) != 0 && errno != EEXIST)
    refuse(std::string("does not exist and cannot be made: ") + std::strerror(errno));
  struct stat found {};
  if (::stat(directory.c_str(), &found) != 0) refuse(std::string("cannot be looked at: ") + std::strerror(errno));
  if (!S_ISDIR(found.st_mode)) refuse("is no directory");
  if (found.st_uid != ::geteuid())
    refuse("belongs to uid " + std::to_string(found.st_uid) + ", the server runs as uid " +
           std::to_string(::geteuid()) +
           "; choose a directory of its own, which the server makes if it does not exist");
  if (private_to_owner && (found.st_mode & 077) != 0)
    refuse("has mode " + octal(found.st_mode) + ": others can enter it; expected 0700. " +
           (is_shared(directory, found.st_mode) ? "Choose" : "chmod 700 " + directory + ", or choose") +
           " one that does not exist, such as " + own_directory() + ": the server makes it");
  if (!private_to_owner && (found.st_mode & 022) != 0)
    refuse(
        "has mode " + octal(found.st_mode) +
        ": others can write to it, so they could put a socket of their own "
        "there; expected 0711 or 0750. " +
        (is_shared(directory, found.st_mode) ? "Choose a directory of the server's own" : "chmod go-w " + directory));
}

// Refuses a path at which a file is that is no socket, or a socket at which a process listens.
void refuse_other_socket(const std::string& path) {
  struct stat existing {};
  if (::lstat(path.c_str(), &existing) == 0 && !S_ISSOCK(existing.st_mode))
    throw std::runtime_error("ipc://" + path +
                             " is a file or directory, not a socket: listening there would delete it; "
                             "choose another path");
  // The lock file alone does not tell this: someone may have removed it while its server listens.
  if (wire::is_served(path))
    throw std::runtime_error("another process listens on ipc://" + path + ", and does not hold the lock file " + path +
                             ".lock; stop it first, or choose another path");
}

wire::Descriptor take_lock(const std::string& path) {
  const std::string lock = path + ".lock";
  wire::Descriptor file(::open(lock.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file < 0)
    throw std::runtime_error("cannot listen on ipc://" + path + ": its lock file " + lock + " cannot be opened: " +
                             std::strerror(errno) + "; choose a path (--bind) where this user may write");
  if (::flock(file, LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK)
      throw std::runtime_error("another server listens on ipc://" + path + " (it holds " + lock +
                               "); stop it first, or choose another path");
    throw std::runtime_error("cannot lock " + lock + ": " + std::strerror(errno));
  }
  refuse_other_socket(path);
  return file;
}

}  // namespace

SocketPath::SocketPath(const std::string& path, bool private_to_owner) : path_(path) {
  check_directory(path, private_to_owner);
  lock_ = take_lock(path);
}

void SocketPath::remember() {
  struct stat found {};
  if (::lstat(path_.c_str(), &found) != 0) return;
  device_ = found.st_dev;
  inode_ = found.st_ino;
}

bool SocketPath::stands() const {
  struct stat found {};
  return inode_ == 0 || (::lstat(path_.c_str(), &found) == 0 && found.st_dev == device_ && found.st_ino == inode_);
}

void SocketPath::take_again(bool private_to_owner) {
  check_directory(path_, private_to_owner);
  struct stat held {};
  struct stat there {};
  const bool locked = ::fstat(lock_, &held) == 0 && ::lstat((path_ + ".lock").c_str(), &there) == 0 &&
                      held.st_dev == there.st_dev && held.st_ino == there.st_ino;
  if (!locked)
    lock_ = take_lock(path_);
  else
    refuse_other_socket(path_);
}

// The attribute is the access list of the kernel: a header, and entries in the order of their tags and user ids. Only
// the owner and the named users may write, which a connection needs; the mask bounds what an entry of a user can give.
bool SocketPath::admit(std::vector<std::uint32_t> users) const {
  if (users.empty()) return true;
  std::sort(users.begin(), users.end());
  users.erase(std::unique(users.begin(), users.end()), users.end());
  constexpr std::uint16_t kUse = ACL_READ | ACL_WRITE;
  constexpr auto kNobody = static_cast<std::uint32_t>(ACL_UNDEFINED_ID);
  std::vector<posix_acl_xattr_entry> entries = {{ACL_USER_OBJ, kUse, kNobody}};
  for (const std::uint32_t user : users) entries.push_back({ACL_USER, kUse, user});
  entries.push_back({ACL_GROUP_OBJ, 0, kNobody});
  entries.push_back({ACL_MASK, kUse, kNobody});
  entries.push_back({ACL_OTHER, 0, kNobody});
  const posix_acl_xattr_header header{POSIX_ACL_XATTR_VERSION};
  std::string list(reinterpret_cast<const char*>(&header), sizeof header);
  list.append(reinterpret_cast<const char*>(entries.data()), entries.size() * sizeof entries[0]);
  if (::setxattr(path_.c_str(), "system.posix_acl_access", list.data(), list.size(), 0) == 0) return true;
  if (errno != EOPNOTSUPP || ::chmod(path_.c_str(), 0777) != 0)
    throw std::runtime_error("cannot let other users connect to " + path_ + ": " + std::strerror(errno));
  return false;
}

// Removes the socket's file, which libzmq leaves behind; while the lock is held no other server can own it. The lock
// file stays, because removing it would race with a server that has just opened it.
SocketPath::~SocketPath() {
  if (lock_ >= 0 && stands()) ::unlink(path_.c_str());
}

}  // namespace shearbus::transport
