// Who may use the server: users of this machine by their uid, clients from elsewhere by their key. Decides about
// connections for the transport, and tells the service who a message is from.
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
  // Reads the keys. Throws std::invalid_argument where options do not go together, std::runtime_error for files that
  // cannot be used.
  explicit Access(const ServerOptions& options);

  const std::string& secret_key() const { return secret_key_; }  // empty: none
  std::string public_key() const;                                // of the server, for its clients
  bool for_other_users() const;

  // On the transport's thread. The file of authorised keys is read again when it has changed; where it cannot be read,
  // no key is admitted until it can.
  transport::Admission judge(const transport::Peer& peer);

  // Whom judge() called so; empty: this process itself.
  static service::Caller caller(std::string_view user);

 private:
  void read_authorized_keys();

  std::vector<std::uint32_t> uids_;
  bool insecure_plaintext_;
  std::string secret_key_;
  std::string keys_file_;
  struct stat keys_stat_ {};
  std::map<std::string, bool> keys_;  // of clients; true: an operator
};

}  // namespace shearbus::server
