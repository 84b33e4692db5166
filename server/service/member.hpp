// A session and the states it owns; of the service's own files only.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/service/service.hpp"

namespace shearbus::service {

struct Service::Member {
  wire::SessionId id{};
  std::string identity;              // of who opened it: nobody else may use it
  wire::ResumeToken resume_token{};  // all zero: nobody may resume the session
  std::uint64_t claim = 0;           // the last one granted, to whom,
  std::uint64_t claimant = 0;
  std::uint64_t epoch = 0;  // and the epoch of the session's requests since; 0: the server's
  session::Session conversation;
  std::unique_ptr<shard::Shard> shard;  // null once closed
  wire::Scene scene;                    // effective
  std::vector<store::MarkImage> marks;  // oldest first
  wire::SessionClosed totals;
};

// A request being answered.
struct Service::Arrival {
  Frames frames;
  Caller caller;
  wire::Request request;
  std::uint64_t hash = 0;  // of the frames
  std::uint64_t started_ns = 0;
};

// What a repeated request is answered with: the reply without its times, since a repeat takes none. So it has the same
// bytes whether the server was restarted in between or not.
void make_repeat(wire::Reply& reply);

}  // namespace shearbus::service
