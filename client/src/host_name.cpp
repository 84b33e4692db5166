#include "client/src/host_name.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>

#include <array>
#include <memory>
#include <string_view>

#include "proto/wire/text.hpp"

namespace shearbus {
namespace {

constexpr std::string_view kTcp = "tcp://";

using Addresses = std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)>;

// Returns the addresses of a host, or null; `fault` then says why.
Addresses addresses_of(const std::string& host, int family, int& fault) {
  addrinfo hints{};
  hints.ai_family = family;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  fault = ::getaddrinfo(host.c_str(), nullptr, &hints, &found);
  return {fault == 0 ? found : nullptr, ::freeaddrinfo};
}

}  // namespace

std::string fault_of_host_name(const std::string& endpoint) {
  const std::size_t colon = endpoint.rfind(':');
  if (!endpoint.starts_with(kTcp) || colon < kTcp.size()) return {};
  const std::string host = endpoint.substr(kTcp.size(), colon - kTcp.size());
  if (host.empty() || host.front() == '[') return {};
  int fault = 0;
  if (addresses_of(host, AF_INET, fault)) return {};
  const Addresses v6 = addresses_of(host, AF_INET6, fault);
  if (!v6)
    return fmt::format("the host name \"{}\" does not resolve: {}", wire::printable(host, NI_MAXHOST),
                       ::gai_strerror(fault));
  std::array<char, INET6_ADDRSTRLEN> text{};
  ::inet_ntop(AF_INET6, &reinterpret_cast<const sockaddr_in6*>(v6->ai_addr)->sin6_addr, text.data(), text.size());
  return fmt::format("the host \"{0}\" has IPv6 addresses alone, which are reached by their numbers: {1}[{2}]{3}", host,
                     kTcp, text.data(), endpoint.substr(colon));
}

}  // namespace shearbus
