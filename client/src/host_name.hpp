// Why a server at the name of a host cannot be reached.
#pragma once

#include <string>

namespace shearbus {

// Looks up the name in an endpoint "tcp://NAME:PORT", which may take seconds. Returns why no connection can be made to
// it: the name is not known, or has IPv6 addresses alone, which libzmq reaches only by their numbers. Returns "" for any
// other endpoint.
std::string fault_of_host_name(const std::string& endpoint);

}  // namespace shearbus
