// How a call of a client ends.
#pragma once

#include "proto/wire/status.hpp"

namespace shearbus::support {

// The code that a call is refused with; kOk if it is not.
template <class Call>
wire::Code code_of(const Call& call) {
  try {
    call();
  } catch (const wire::Error& fault) {
    return fault.status().code;
  }
  return wire::Code::kOk;
}

}  // namespace shearbus::support
