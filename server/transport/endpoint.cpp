#include "server/transport/endpoint.hpp"

#include <charconv>
#include <stdexcept>

#include "proto/wire/host_process.hpp"

namespace shearbus::transport {
namespace {

[[noreturn]] void refuse(std::string_view text, const std::string& fault) {
  throw std::invalid_argument(
      "endpoint \"" + std::string(text) + "\": " + fault +
      "; expected tcp://ADDRESS:PORT or ipc://PATH, for example ipc:///run/user/1000/shearbus/bus");
}

bool is_port(std::string_view port) {
  if (port == "*") return true;
  unsigned number = 0;
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), number);
  return error == std::errc() && end == port.data() + port.size() && number <= 65535;
}

Endpoint parse_tcp(Endpoint endpoint, std::string_view address) {
  const std::size_t colon = address.rfind(':');
  if (colon == std::string_view::npos || colon == 0) refuse(endpoint.text, "has no address or no port");
  std::string_view host = address.substr(0, colon);
  if (host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  endpoint.host = host;
  endpoint.port = address.substr(colon + 1);
  if (!is_port(endpoint.port)) refuse(endpoint.text, "has port \"" + endpoint.port + "\", not a number up to 65535");
  return endpoint;
}

}  // namespace

Endpoint Endpoint::parse(std::string_view text) {
  Endpoint endpoint;
  endpoint.text = text;
  const std::size_t end_of_scheme = text.find("://");
  if (end_of_scheme == std::string_view::npos) refuse(text, "has no scheme");
  const std::string_view scheme = text.substr(0, end_of_scheme);
  const std::string_view address = text.substr(end_of_scheme + 3);
  if (address.empty()) refuse(text, "has no address");
  if (scheme == "tcp") {
    endpoint.scheme = Scheme::kTcp;
    return parse_tcp(std::move(endpoint), address);
  }
  if (scheme == "ipc") {
    // Wildcard ("*") and abstract ("@name") sockets have no file, so neither permissions nor a lock could protect them.
    if (address == "*" || address.front() == '@') refuse(text, "is not a path");
    if (address.size() > wire::kLongestSocketPath)
      refuse(text, "has a path of " + std::to_string(address.size()) + " bytes, and the path of a socket has at most " +
                       std::to_string(wire::kLongestSocketPath));
    if (address.front() == '~') refuse(text, "begins with ~, which only a shell replaces by a home directory");
    endpoint.scheme = Scheme::kIpc;
    endpoint.path = address;
    return endpoint;
  }
  if (scheme == "inproc") {
    endpoint.scheme = Scheme::kInproc;
    return endpoint;
  }
  refuse(text, "has scheme \"" + std::string(scheme) + "\"");
}

void Endpoint::refuse_unprotected() const {
  if (scheme == Scheme::kTcp)
    throw std::invalid_argument("endpoint \"" + text +
                                "\": whoever reaches it would be served, unknown and unencrypted; use ipc://, or give "
                                "the server keys with --curve-secret and --authorized-keys, or accept that with "
                                "--insecure-plaintext");
}

}  // namespace shearbus::transport
