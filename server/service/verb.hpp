// A kind of request. Included only by the source files of the service.
#pragma once

#include <cstddef>

#include "server/service/service.hpp"

namespace shearbus::service {

// What a verb needs of a step that is not committed yet.
enum class Service::Trial { kAny, kMustStand, kMustNotStand };

struct Service::Verb {
  std::size_t body;           // place of its body in wire::Request::body
  bool sequence = false;      // it is the next request of a session, and has a number in it
  bool of_operators = false;  // nobody else may ask for it
  Trial trial{};              // of the session
  // It may change which nodes the session has, so it waits while another request does in the domain.
  bool changes_domain = false;
  ReplyPtr (*handler)(Service&, const Verb&, Member*, Arrival&, const ReplyPtr&);
};

}  // namespace shearbus::service
