// Decides which clients may use the server: users of this machine by their uid, clients from other machines by their
// key. The transport asks it about connections, the server about the sender of a message.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "server/options.hpp"
#include "server/service/service.hpp"
#include "server/transport/access.hpp"

namespace shearbus::server {

class Access {
 public:
  // Throws std::invalid_argument for options that exclude or need each other.
  static void check(const ServerOptions& options);

  // Reads the key files that the options name. Throws std::invalid_argument for options that exclude each other,
  // std::runtime_error for files that cannot be used.
  explicit Access(const ServerOptions& options);

  const std::string& secret_key() const { return secret_key_; }  // the server's secret key; empty: it has none
  std::string public_key() const;                                // public key of the server, for its clients
  std::vector<std::uint32_t> other_users() const;                // admitted users except the server's own

  // Decides whether a peer may connect. Called on a thread of the transport. Reads the file of authorised keys again
  // after a change; while the file cannot be read, no key is admitted.
  transport::Admission judge(const transport::Peer& peer);

  // Reads the file of authorised keys again if it has changed, and returns a line for the log for each key that was
  // admitted and is no longer on the list, or has another role there. A file that cannot be used revokes nothing. Called
  // once a second by the thread that asks revoked().
  std::vector<std::string> look_for_revoked();
  // Whether the key behind a user name given by judge() was revoked since.
  bool any_revoked() const { return !revoked_.empty(); }
  bool revoked(std::string_view user) const { return !revoked_.empty() && revoked_.contains(user); }

  // Returns the caller behind a user name given by judge(); an empty name means a client inside this
  // process.
  static service::Caller caller(std::string_view user);

 private:
  void read_authorized_keys();

  std::vector<std::uint32_t> uids_;
  bool insecure_plaintext_;
  std::string secret_key_;
  std::string keys_file_;
  std::mutex mutex_;  // of the next four, which two threads use
  struct stat keys_stat_ {};
  std::map<std::string, bool> keys_;             // public key of a client -> true for an operator
  std::map<std::string, std::string> admitted_;  // user names of keys that were admitted -> the key
  std::string fault_;                            // why the file of keys could not be used at the last look
  std::set<std::string, std::less<>> revoked_;   // user names of keys that were admitted and are not any more
};

}  // namespace shearbus::server
