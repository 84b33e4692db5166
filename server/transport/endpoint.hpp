// Where a server may listen. libzmq knows more transports than these; a name of another is refused before it gets
// there.
#pragma once

#include <string>
#include <string_view>

namespace shearbus::transport {

enum class Scheme { kTcp, kIpc, kInproc };

struct Endpoint {
  Scheme scheme = Scheme::kIpc;
  std::string text;  // as given: what libzmq is told
  std::string host;  // tcp: without brackets
  std::string port;  // tcp: a number, or "*" for any free one
  std::string path;  // ipc

  // Throws std::invalid_argument: expected, found, remedy.
  static Endpoint parse(std::string_view text);
};

}  // namespace shearbus::transport
