// An address at which a server may listen: tcp, ipc, or inproc for clients inside the server's process. Endpoints of
// libzmq's other transports are refused before libzmq sees them.
#pragma once

#include <string>
#include <string_view>

namespace shearbus::transport {

enum class Scheme { kTcp, kIpc, kInproc };

struct Endpoint {
  Scheme scheme = Scheme::kIpc;
  std::string text;  // the whole endpoint as given, for libzmq
  std::string host;  // tcp: address without brackets
  std::string port;  // tcp: a port number, or "*" for any free port
  std::string path;  // ipc: path of the socket

  // Throws std::invalid_argument with the expected form, the text found and a remedy.
  static Endpoint parse(std::string_view text);

  // Throws std::invalid_argument for a tcp endpoint of a server that has no keys and was not told to do without.
  void refuse_unprotected() const;
};

}  // namespace shearbus::transport
