// What each user has and may have: quotas of sessions and memory, and the counters that the user may see. A user is the
// identity that opened a session: a uid, a key, or everybody who comes without either.
#include <fmt/format.h>

#include <utility>
#include <vector>

#include "proto/wire/text.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;

namespace {

double megabytes(std::uint64_t bytes) {
  return static_cast<double>(bytes) / (1 << 20);
}

}  // namespace

Service::User& Service::user(std::string_view identity) {
  const auto found = users_.find(identity);
  return found != users_.end() ? found->second : users_[std::string(identity)];
}

// The sessions, nodes and memory of a user, with the user's counters.
wire::ServerStatus Service::usage_of(std::string_view identity) const {
  const auto known = users_.find(identity);
  wire::ServerStatus usage = known != users_.end() ? known->second.counted : wire::ServerStatus();
  for (const auto& [id, member] : members_) {
    if (!member->shard || member->identity != identity) continue;
    ++usage.sessions;
    usage.nodes += member->changing ? member->nodes_before : member->shard->nodes().size();
    usage.state_bytes += member->changing ? member->held_before : member->held_bytes();
  }
  for (const auto& [id, transfer] : transfers_) {
    if (transfer->identity != identity) continue;
    usage.nodes += transfer->node_ids.size();
    usage.state_bytes += kept_bytes(transfer->states);
  }
  return usage;
}

// The server's own user decides about the server, so operators have no quota. Requests that are replayed were checked
// when they ran first.
void Service::check_session_quota(const Caller& caller) const {
  if (caller.is_operator || replaying_) return;
  const std::uint64_t sessions = usage_of(caller.identity).sessions;
  if (sessions < options_.max_sessions_per_user) return;
  refuse(Code::kLimit, "", fmt::format("{} has {} sessions open, the quota of a user", caller.identity, sessions),
         "Close sessions that are no longer used, or ask the operator of the server for a larger "
         "--sessions-per-user.");
}

// Refuses states that the quota of the user `owner`, or the server, has no memory for.
void Service::check_memory(std::uint64_t wanted, std::size_t nodes, const Caller& caller,
                           std::string_view owner) const {
  const std::uint64_t most = options_.max_state_bytes_per_user, all = options_.max_state_bytes;
  const std::uint64_t used = caller.is_operator || replaying_ ? 0 : usage_of(owner).state_bytes;
  if (!caller.is_operator && !replaying_ && (used > most || wanted > most - used))
    refuse(Code::kLimit, "",
           fmt::format("the states of {} need {:.1f} MB; {} has {:.1f} MB in use, and the quota of a user is {:.1f} MB",
                       wire::counted(nodes, "node"), megabytes(wanted), owner, megabytes(used), megabytes(most)),
           "Use a graded grid with fewer cells, close sessions, or ask the operator of the server for "
           "a larger --memory-per-user-mb.");
  if (metrics_.state_bytes > all || wanted > all - metrics_.state_bytes)
    refuse(Code::kLimit, "",
           fmt::format("the states of {} need {:.1f} MB; {:.1f} of {:.1f} MB are in use", wire::counted(nodes, "node"),
                       megabytes(wanted), megabytes(metrics_.state_bytes), megabytes(all)),
           "Use a graded grid with fewer cells, close sessions, or give the server more memory.");
}

wire::ServerStatus Service::with_server(wire::ServerStatus status) const {
  status.uptime_ns = options_.now_ns() - started_ns_;
  status.threads = pool_.threads();
  status.server_version = options_.server_version;
  status.draining = draining_;
  return status;
}

// The regimes are counted only here: a step does no work for them.
wire::ServerStatus Service::status_for(const Caller& caller) const {
  wire::ServerStatus found = caller.is_operator ? status() : with_server(usage_of(caller.identity));
  found.regimes.resize(wire::kRegimeCount);
  for (const auto& [id, member] : members_)
    if (member->shard && !member->changing && (caller.is_operator || member->identity == caller.identity))
      member->shard->count_regimes(found.regimes);
  return found;
}

}  // namespace shearbus::service
