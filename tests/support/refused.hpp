// How a call ends that may be refused.
#pragma once

#include <string>

#include "proto/wire/status.hpp"

namespace shearbus::support {

// The status that a call is refused with; its code is kOk if it is not.
template <class Call>
wire::Status fault_of(const Call& call) {
  try {
    call();
  } catch (const wire::Error& fault) {
    return fault.status();
  }
  return {};
}

template <class Call>
wire::Code code_of(const Call& call) {
  return fault_of(call).code;
}

// What a call says that throws `Fault`; nothing if it does not throw.
template <class Fault, class Call>
std::string said_by(const Call& call) {
  try {
    call();
  } catch (const Fault& fault) {
    return fault.what();
  }
  return {};
}

}  // namespace shearbus::support
