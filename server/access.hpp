// Decides which clients may use the server: users of this machine by their uid, clients from other machines by their
// key. The transport asks it about connections, the server about the sender of a message.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "server/options.hpp"
#include "server/service/service.hpp"
#include "server/transport/access.hpp"

namespace shearbus::server {

class Access {
 public:
  // Reads the key files that the options name. Throws std::invalid_argument for options that exclude each other,
  // std::runtime_error for files that cannot be used.
  explicit Access(const ServerOptions& options);

  const std::string& secret_key() const { return secret_key_; }  // the server's secret key; empty: it has none
  std::string public_key() const;                                // public key of the server, for its clients
  std::vector<std::uint32_t> other_users() const;                // admitted users except the server's own

  // Decides whether a peer may connect. Called on a thread of the transport. Reads the file of authorised keys again
  // after a change; while the file cannot be read, no key is admitted.
  transport::Admission judge(const transport::Peer& peer);

  // Returns the caller behind a user name given by judge(); an empty name means a client inside this
  // process.
  static service::Caller caller(std::string_view user);

 private:
  void read_authorized_keys();

  std::vector<std::uint32_t> uids_;
  bool insecure_plaintext_;
  std::string secret_key_;
  std::string keys_file_;
  struct stat keys_stat_ {};
  std::map<std::string, bool> keys_;  // public key of a client -> true for an operator
};

}  // namespace shearbus::server
