// Requests of operators: checkpoint, drain and inspect.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

namespace {

// A node that may enter a list of top nodes: its row in the session, and the value by which the list is sorted.
struct Candidate {
  double value;
  std::uint32_t row;
};

// Sliding velocities of all nodes in the last step. They are no part of a state, so the kept reply must have them.
std::span<const double> sliding_velocities(const wire::Reply& last, std::size_t nodes) {
  const std::span<const double> column = std::holds_alternative<wire::Upscale>(last.body)
                                             ? last.batch.f64(Field::kSlidingVelocity)
                                             : std::span<const double>();
  if (column.size() != nodes)
    refuse(
        Code::kInvalidValue, "inspect.top",
        "the session's last request was no step of all its nodes that asked for their sliding velocities, and nothing "
        "else keeps them",
        "Ask again after such a step, or for the hottest.");
  return column;
}

}  // namespace

void Service::check_operator(const Caller& caller) const {
  if (caller.is_operator) return;
  log(fmt::format("REFUSED: {} asked for what only an operator may", caller.identity));
  refuse(Code::kNotPermitted, "", fmt::format("{} is no operator of this server", caller.identity),
         "Ask as the server's own user, by ipc, or with a key marked \"operator\" on its list.");
}

Service::ReplyPtr Service::tell_status(const wire::ServerStatusQuery& /*asked*/, Arrival& arrival,
                                       const ReplyPtr& reply) {
  reply->body = status_for(arrival.caller);
  return reply;
}

Service::ReplyPtr Service::checkpoint_now(const wire::Checkpoint& /*asked*/, Arrival& /*arrival*/,
                                          const ReplyPtr& reply) {
  if (must_wait_for_changes()) return reply;
  if (store_ == nullptr)
    refuse(Code::kUnsupported, "", "this server has no state directory to write a checkpoint to",
           "Start it with --state-dir.");
  const std::uint64_t started_ns = options_.now_ns();
  if (!checkpoint_in_turn())
    refuse(Code::kCheckpointFailed, "", "the checkpoint could not be written; the server's log tells why",
           "The checkpoints before and the journal hold everything. Mend the disk and ask again.");
  reply->body =
      wire::Checkpointed{.bytes = store_->counters().checkpoint_bytes, .duration_ns = options_.now_ns() - started_ns};
  return reply;
}

Service::ReplyPtr Service::drain(const wire::Drain& drain, Arrival& arrival, const ReplyPtr& reply) {
  if (drain.within_s != 0 && (!drain.exit || drain.within_s > wire::kMaxDrainS))
    refuse(Code::kInvalidValue, "drain.within_s",
           fmt::format("drain.within_s = {}{}", drain.within_s,
                       drain.exit ? fmt::format(", expected at most {}", wire::kMaxDrainS)
                                  : " without drain.exit, which it limits"),
           "Ask for the end of the server, too, within a year.");
  log(fmt::format("{} drains the server: no new sessions{}{}; {} are open", arrival.caller.identity,
                  drain.exit ? ", and the end with the last" : "",
                  drain.within_s != 0 ? fmt::format(", or in {} s", drain.within_s) : "", metrics_.sessions));
  draining_ = true;
  exit_when_drained_ = exit_when_drained_ || drain.exit;
  if (drain.within_s != 0) drain_until_ns_ = options_.now_ns() + 1'000'000'000 * drain.within_s;
  reply->body = wire::Draining{.sessions = metrics_.sessions};
  return reply;
}

wire::SessionInfo Service::info_of(const Member& member) const {
  const shard::Shard& shard = *member.shard;
  const std::uint64_t now_ns = options_.now_ns();
  std::vector<std::uint64_t> regimes(wire::kRegimeCount, 0);
  shard.count_regimes(regimes);
  return {.session_id = member.id,
          .name = member.scene_name,
          .identity = member.identity,
          .nodes = shard.nodes().size(),
          .last_sequence = member.conversation.last_sequence(),
          .state_version = shard.state_version(),
          .trial_stands = member.trial_stands(),
          .age_ns = now_ns - member.opened_ns,
          .idle_ns = now_ns - member.last_request_ns,
          .state_bytes = shard.state_bytes(),
          .requests = member.requests,
          .node_steps = member.node_steps,
          .solver_ns = member.solver_ns,
          .regimes = std::move(regimes),
          .domain = member.domain,
          .idle_limit_s = member.idle_limit_s};
}

Service::ReplyPtr Service::inspect(const wire::Inspect& inspect, Arrival& arrival, const ReplyPtr& reply) {
  if (must_wait_for_changes()) return reply;
  const wire::Request& request = arrival.request;
  auto& answer = reply->body.emplace<wire::Inspected>();
  if (request.session_id != wire::SessionId{}) {
    Member& member = open_member(request.session_id);
    answer.sessions.push_back(info_of(member));
    top_nodes(member, inspect, *reply);
    return reply;
  }
  for (auto member = members_.upper_bound(inspect.after); member != members_.end(); ++member) {
    if (!member->second->shard) continue;
    if (answer.sessions.size() == wire::kMaxSessionsListed) {
      answer.more = true;
      break;
    }
    answer.sessions.push_back(info_of(*member->second));
  }
  return reply;
}

void Service::top_nodes(const Member& member, const wire::Inspect& inspect, wire::Reply& reply) const {
  const shard::Shard& shard = *member.shard;
  auto& answer = std::get<wire::Inspected>(reply.body);
  if (inspect.count == 0) return;
  if (inspect.count > wire::kMaxTopNodes)
    refuse(Code::kLimit, "inspect.count",
           fmt::format("{} top nodes asked for, at most {} are told", inspect.count, wire::kMaxTopNodes), "");
  if (inspect.top == wire::Top::kUnspecified)
    refuse(Code::kInvalidValue, "inspect.top", "inspect.top is not given, expected HOTTEST, FASTEST or MOLTEN", "");
  const bool fastest = inspect.top == wire::Top::kFastest;
  std::span<const double> sliding;
  if (fastest) sliding = sliding_velocities(*member.conversation.kept_reply(), shard.nodes().size());

  std::vector<Candidate> nodes;
  nodes.reserve(shard.nodes().size());
  for (std::uint32_t row = 0; row < shard.nodes().size(); ++row) {
    const shard::NodeGlance glance = shard.glance(shard.nodes().slot_of(row));
    const bool molten = glance.regime == static_cast<std::uint8_t>(wire::Regime::kMelting);
    if (inspect.top == wire::Top::kMolten && !molten) continue;
    nodes.push_back({fastest ? std::abs(sliding[row]) : glance.interface_temperature, row});
  }
  answer.matching = nodes.size();
  const std::size_t count = std::min<std::size_t>(inspect.count, nodes.size());
  std::partial_sort(
      nodes.begin(), nodes.begin() + static_cast<std::ptrdiff_t>(count), nodes.end(),
      [](const Candidate& a, const Candidate& b) { return a.value != b.value ? a.value > b.value : a.row < b.row; });

  std::vector<Field> fields = {Field::kNodeId, Field::kInterfaceTemperature, Field::kShearStress, Field::kRegime};
  if (fastest) fields.push_back(Field::kSlidingVelocity);
  reply.batch = wire::Batch::of(fields, count);
  for (std::size_t place = 0; place < count; ++place) {
    const std::uint32_t row = nodes[place].row;
    const shard::NodeGlance glance = shard.glance(shard.nodes().slot_of(row));
    reply.batch.u64(Field::kNodeId)[place] = shard.nodes().ids()[row];
    reply.batch.f64(Field::kInterfaceTemperature)[place] = glance.interface_temperature;
    reply.batch.f64(Field::kShearStress)[place] = glance.shear_stress;
    reply.batch.u8(Field::kRegime)[place] = glance.regime;
    if (fastest) reply.batch.f64(Field::kSlidingVelocity)[place] = sliding[row];
  }
}

}  // namespace shearbus::service
