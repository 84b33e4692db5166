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
  std::string domain;                   // empty: none
  std::string scene_name;
  std::string scene;            // effective, as canonical text
  std::uint64_t opened_ns = 0;  // by the service's clock; a recovered session: when it was taken up
  std::uint64_t last_request_ns = 0;
  std::vector<store::MarkImage> marks;  // oldest first
  wire::SessionClosed totals;

  std::uint64_t held_bytes() const;  // of states, marks included
  Domain domain_it_is_in() const { return {identity, domain}; }
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

// A reply's list of nodes.
wire::Batch node_column(std::span<const std::uint64_t> node_ids);

// Memory of states kept beside a shard, as marks and transfers keep them: each once, with the ids of their nodes.
std::uint64_t kept_bytes(const shard::States& states);
std::uint64_t kept_bytes(const physics::Model& model, std::size_t nodes);

// The beginning of a session's id, for people: the whole of it would let them speak in its name.
std::string short_name(const wire::SessionId& id);

// A client's words, fit for one line of a log.
std::string printable(const std::string& text);

}  // namespace shearbus::service
