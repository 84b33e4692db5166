// Trials that are committed or rolled back, and marks: named copies of a session's nodes and states, with the rollback to
// them.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/limits.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;

namespace {

const std::string& mark_name(const std::shared_ptr<const store::MarkImage>& mark) {
  return mark->name;
}

std::string names_of(const std::vector<std::shared_ptr<const store::MarkImage>>& marks) {
  std::string names;
  for (const auto& mark : marks) names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", printable(mark->name));
  return names.empty() ? "none" : names;
}

}  // namespace

void Service::commit(Member& member, const wire::Commit& /*asked*/, const Arrival& arrival, wire::Reply& reply) {
  journal(arrival, member.id, &member);
  member.shard->commit();
  reply.body = wire::Committed{.state_version = member.shard->state_version()};
}

void Service::mark(Member& member, const wire::Mark& mark, const Arrival& arrival, wire::Reply& reply) {
  check_name(mark.name, "mark.name");
  const shard::Shard& shard = *member.shard;
  member.marks.reserve(wire::kMaxMarks + 1);
  auto gone = std::ranges::find(member.marks, mark.name, mark_name);
  if (gone == member.marks.end() && member.marks.size() == wire::kMaxMarks) gone = member.marks.begin();
  const std::uint64_t freed = gone == member.marks.end() ? 0 : kept_bytes((*gone)->states);
  const std::uint64_t wanted = kept_bytes(shard, shard.nodes().size());
  check_memory(wanted > freed ? wanted - freed : 0, shard.nodes().size(), arrival.caller, member.identity);
  auto& answer = reply.body.emplace<wire::Marked>();
  answer.state_version = shard.state_version();
  for (auto old = member.marks.begin(); old != member.marks.end(); ++old)
    if (old != gone) answer.names.push_back((*old)->name);
  answer.names.push_back(mark.name);
  auto made = std::make_shared<store::MarkImage>(store::MarkImage{
      .name = mark.name, .sequence = arrival.request.sequence, .state_version = shard.state_version()});
  aside(wanted, [&] {
    made->node_ids = shard.nodes().ids();
    made->states = shard.committed_states();
  });
  check_memory(wanted > freed ? wanted - freed : 0, shard.nodes().size(), arrival.caller,
               member.identity);  // once more
  journal(arrival, member.id, &member);

  MarkPtr dropped;
  if (gone != member.marks.end()) {
    dropped = std::move(*gone);
    member.marks.erase(gone);
  }
  member.marks.push_back(std::move(made));
  metrics_.state_bytes += wanted - freed;
  change_aside(member, freed, [&] { dropped.reset(); });
}

void Service::rollback(Member& member, const wire::Rollback& rollback, const Arrival& arrival, wire::Reply& reply) {
  if (rollback.to_mark.empty()) {
    journal(arrival, member.id, &member);
    member.shard->rollback();
    member.parts.reset();
  } else {
    const auto found = std::ranges::find(member.marks, rollback.to_mark, mark_name);
    if (found == member.marks.end())
      refuse(Code::kUnknownMark, "rollback.to_mark",
             fmt::format("no mark has the name \"{}\"; the session has {}", printable(rollback.to_mark),
                         names_of(member.marks)),
             fmt::format("Name a mark that it has, or mark first; the newest {} are kept.", wire::kMaxMarks));
    const MarkPtr to = *found;
    aside(bytes_of_lists(to->node_ids.size()), [&] { reply.batch = node_column(to->node_ids); });
    rollback_to(member, *to, arrival);
  }
  reply.body = wire::RolledBack{.state_version = member.shard->state_version()};
}

// Restores the nodes of the mark with their states. Nodes registered after the mark leave the session. Nodes retired
// after the mark return to the session, and so do nodes offered after the mark whose offer is not accepted yet. Throws
// NODE_OWNED if another session has one of the nodes.
void Service::rollback_to(Member& member, const store::MarkImage& mark, const Arrival& arrival) {
  const shard::Shard& before = *member.shard;
  const std::uint64_t bytes = kept_bytes(mark.states);
  std::unique_ptr<shard::Shard> other_nodes;
  bool other = false;
  aside(bytes, [&] {
    other = mark.node_ids != before.nodes().ids() ||
            (member.pairs.several() && !SessionPairs::same_pairs(mark.states, before.committed_states()));
  });
  if (other) {
    check_owners(member.domain_it_is_in(), &member, mark.sequence, mark.node_ids);
    const auto check_room = [&](std::uint64_t wanted) {
      check_memory(wanted > before.state_bytes() ? wanted - before.state_bytes() : 0, mark.node_ids.size(),
                   arrival.caller, member.identity);
    };
    check_room(before.bytes_for(mark.node_ids.size()));
    aside(bytes, [&] {
      other_nodes = restored_shard(member.pairs, before.pairs(), mark.node_ids, mark.states);
      other_nodes->restore(mark.states, nullptr, mark.state_version);
    });
    check_room(other_nodes->state_bytes());  // more where nodes of few pairs share a tile
  }
  journal(arrival, member.id, &member);

  member.parts.reset();
  member.operators_made_for = 0.0;
  metrics_.nodes += mark.node_ids.size() - before.nodes().size();
  metrics_.state_bytes -= member.held_bytes();
  if (other_nodes) std::swap(member.shard, other_nodes);
  const auto restore = [&] {
    if (other_nodes)
      other_nodes.reset();
    else
      member.shard->restore(mark.states, nullptr, mark.state_version);
  };
  change_aside(member, bytes, std::cref(restore));  // without a copy, for which there may be no memory
  withdraw_offers(member, mark.sequence);
  metrics_.state_bytes += member.held_bytes();
}

// Withdraws the offers that the session made after its request `after_sequence`, and drops the marks made after the
// first of these offers.
void Service::withdraw_offers(Member& member, std::uint64_t after_sequence) {
  std::uint64_t first_withdrawn = std::numeric_limits<std::uint64_t>::max();
  std::erase_if(transfers_, [&](const auto& entry) {
    const store::TransferImage& transfer = *entry.second;
    if (transfer.giver != member.id || transfer.sequence <= after_sequence) return false;
    metrics_.nodes -= transfer.node_ids.size();
    metrics_.state_bytes -= kept_bytes(transfer.states);
    first_withdrawn = std::min(first_withdrawn, transfer.sequence);
    return true;
  });
  std::erase_if(member.marks, [&](const MarkPtr& made) { return made->sequence > first_withdrawn; });
}

}  // namespace shearbus::service
