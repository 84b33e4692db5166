// A session and its states. Included only by the source files of the service.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/service/parts.hpp"
#include "server/service/service.hpp"

namespace shearbus::service {

struct Service::Member {
  wire::SessionId id{};
  std::string identity;              // identity that opened the session; only it and operators may use it
  wire::ResumeToken resume_token{};  // all zero: the session cannot be resumed
  std::uint64_t claim = 0;           // number of the last granted claim of a client (resume_session); 0: none yet
  std::uint64_t claimant = 0;        // random number of the client to which the last claim was granted
  std::uint64_t epoch = 0;           // epoch that requests must name since the last claim; 0: the server's epoch
  session::Session conversation;
  std::unique_ptr<shard::Shard> shard;  // null after the session has been closed
  std::string domain;                   // name of the session's domain; empty: none
  std::string scene_name;
  std::string scene;            // effective scene, as canonical text
  std::uint64_t opened_ns = 0;  // time of the opening, or of the recovery, by the service's clock
  std::uint64_t last_request_ns = 0;
  std::uint64_t idle_limit_s = 0;       // 0: none
  std::string closed_because;           // reason of a closed session; empty: none given
  std::optional<Parts> parts;           // a step of which parts are missing
  std::vector<store::MarkImage> marks;  // oldest first
  wire::SessionClosed totals;

  // Whether a trial stands that could be committed. A step of which parts are missing is none.
  bool trial_stands() const { return shard->has_trial() && !parts; }
  std::uint64_t held_bytes() const;  // memory of states and marks  [bytes]
  Domain domain_it_is_in() const { return {identity, domain}; }
};

// A request being answered.
struct Service::Arrival {
  Frames frames;
  Caller caller;
  wire::Request request;
  std::uint64_t hash = 0;  // hash of the frames
  std::uint64_t started_ns = 0;
};

// Turns a reply into the answer to a repeated request: without times, so that it has the same bytes whether or not the
// server was restarted in between.
void make_repeat(wire::Reply& reply);

// A batch whose only column is the ids of the nodes.
wire::Batch node_column(std::span<const std::uint64_t> node_ids);

// Memory in bytes of the states that a mark or a transfer stores, including the ids of their nodes.
std::uint64_t kept_bytes(const shard::States& states);
std::uint64_t kept_bytes(const shard::Shard& shard, std::size_t nodes);

// The first digits of a session's id, for logs: the whole id is a secret of its client.
std::string short_name(const wire::SessionId& id);

// A text of a client, as one printable line of a log.
std::string printable(const std::string& text);

}  // namespace shearbus::service
