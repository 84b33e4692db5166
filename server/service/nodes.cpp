// The set of a session's nodes: registering and retiring nodes, and moving nodes between sessions.
//
// Within its domain a node belongs to one session or to one transfer (an offer that waits to be accepted). offer_nodes
// moves nodes from a session to a transfer, accept_nodes moves them from a transfer to a session. Each of the two is
// one request of one session, journaled and answered like any other request, so a crash between them leaves the nodes
// in the transfer.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

namespace {

std::vector<std::uint64_t> sorted(std::span<const std::uint64_t> ids) {
  std::vector<std::uint64_t> all(ids.begin(), ids.end());
  std::sort(all.begin(), all.end());
  return all;
}

std::vector<std::uint64_t> common_to(std::span<const std::uint64_t> sorted_ids, std::span<const std::uint64_t> ids) {
  std::vector<std::uint64_t> common;
  std::ranges::set_intersection(sorted_ids, sorted(ids), std::back_inserter(common));
  return common;
}

void check_transfer_id(const wire::TransferId& id) {
  if (id == wire::TransferId{})
    refuse(Code::kInvalidValue, "transfer_id", "transfer_id is all zero; expected 16 random bytes",
           "Draw them from the system's random source.");
}

void check_in_domain(const std::string& domain) {
  if (domain.empty())
    refuse(Code::kUnsupported, "open_session.domain", "the session has no domain: its nodes are its own",
           "Open sessions that exchange nodes with the same open_session.domain.");
}

// Quotes printable(text) as one word of a shell command.
std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : printable(text)) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

// Name of the run whose nodes are divided over several servers, each with a domain NAME#SHARD/SHARDS; of any other
// domain its name.
std::string_view run_of(std::string_view domain) {
  const std::size_t at = domain.rfind('#');
  if (at == std::string_view::npos) return domain;
  const std::string_view part = domain.substr(at + 1);
  const std::size_t slash = part.find('/');
  const auto is_number = [](std::string_view digits) {
    return !digits.empty() && digits.find_first_not_of("0123456789") == std::string_view::npos;
  };
  const bool divided =
      slash != std::string_view::npos && is_number(part.substr(0, slash)) && is_number(part.substr(slash + 1));
  return divided ? domain.substr(0, at) : domain;
}

}  // namespace

std::uint64_t bytes_of_lists(std::size_t nodes) {
  return kBytesPerId * nodes;
}

wire::Batch node_column(std::span<const std::uint64_t> node_ids) {
  constexpr std::array kColumns = {Field::kNodeId};
  wire::Batch batch = wire::Batch::of(kColumns, node_ids.size());
  std::ranges::copy(node_ids, batch.u64(Field::kNodeId).begin());
  return batch;
}

std::uint64_t kept_bytes(const shard::Shard& shard, std::size_t nodes) {
  return nodes * (shard.bytes_of_state() + sizeof(std::uint64_t) + sizeof(std::uint32_t));
}

std::uint64_t kept_bytes(const shard::States& states) {
  std::uint64_t bytes = states.rows.size() * (sizeof(std::uint64_t) + sizeof(std::uint32_t));
  for (const shard::StateColumn& column : states.columns) bytes += column.values.size() * sizeof(double);
  return bytes;
}

std::uint64_t Service::Member::held_bytes() const {
  std::uint64_t bytes = shard->state_bytes();
  for (const MarkPtr& mark : marks) bytes += kept_bytes(mark->states);
  return bytes;
}

// Throws NODE_OWNED if one of the nodes belongs to another session of the domain than `self`, or to an offer that waits
// to be accepted. Offers that `self` made after its request `withdrawn_after` do not count, because the present request
// withdraws them. Throws INVALID_VALUE if a session of the same run is open here in another domain.
void Service::check_owners(const Domain& domain, const Member* self, std::uint64_t withdrawn_after,
                           std::span<const std::uint64_t> node_ids) {
  if (domain.name.empty()) return;
  std::vector<std::uint64_t> ids;
  aside(kBytesPerId * node_ids.size(), [&] { ids = sorted(node_ids); });
  const auto seconds_since = [&](std::uint64_t then_ns) {
    return 1e-9 * static_cast<double>(options_.now_ns() - then_ns);
  };
  const auto refuse_owned = [&](std::vector<std::uint64_t> owned, const std::string& holder,
                                const std::string& remedy) {
    refuse(Code::kNodeOwned, wire::name(Field::kNodeId),
           fmt::format("node {} of domain \"{}\" belongs to {} ({} of {} nodes at fault)", owned.front(),
                       printable(std::string(domain.name)), holder, owned.size(), ids.size()),
           remedy, owned);
  };
  std::vector<std::pair<wire::SessionId, const Member*>> sessions;  // of the domain
  std::vector<const store::TransferImage*> offers;
  for (const auto& [id, other] : members_) {
    if (!other->shard || other.get() == self || other->identity != domain.identity) continue;
    if (other->domain != domain.name && !other->domain.empty() && run_of(other->domain) == run_of(domain.name))
      refuse(Code::kInvalidValue, "open_session.domain",
             fmt::format("the domain is \"{}\", and session {} of the same run is open in \"{}\": their "
                         "clients divide the nodes over different servers",
                         printable(std::string(domain.name)), short_name(id), printable(other->domain)),
             "Give all clients of a run the same endpoints in the same order.");
    if (other->domain_it_is_in() != domain) continue;
    sessions.emplace_back(id, other.get());
  }
  for (const auto& [id, transfer] : transfers_) {
    if (Domain{transfer->identity, transfer->domain} != domain) continue;
    if (self == nullptr || transfer->giver != self->id || transfer->sequence <= withdrawn_after)
      offers.push_back(transfer.get());
  }
  // No other request changes the nodes of the domain meanwhile.
  std::vector<std::uint64_t> owned;
  std::size_t holder = 0;
  aside(kBytesPerId * ids.size() * (sessions.size() + offers.size()), [&] {
    for (holder = 0; owned.empty() && holder < sessions.size() + offers.size(); ++holder)
      owned = holder < sessions.size() ? sessions[holder].second->shard->nodes().common(ids)
                                       : common_to(ids, offers[holder - sessions.size()]->node_ids);
  });
  if (owned.empty()) return;
  --holder;
  if (holder >= sessions.size())
    refuse_owned(std::move(owned),
                 fmt::format("no session: session {} offers it", short_name(offers[holder - sessions.size()]->giver)),
                 "Accept the offer with its transfer_id.");
  const auto& [id, other] = sessions[holder];
  refuse_owned(
      std::move(owned),
      fmt::format("session {} (\"{}\"), opened {:.0f} s ago and idle for {:.0f} s", short_name(id),
                  printable(other->scene_name), seconds_since(other->opened_ns), seconds_since(other->last_request_ns)),
      fmt::format("Its holder retires it or offers it; or give the node another id, or the session another "
                  "domain. If the clients of the domain are gone for good: shearbus-ctl close --domain {}",
                  quoted(std::string(domain.name))));
}

// Applies a prepared change of the set of nodes, in which states of `bytes` move; cannot fail.
void Service::apply(Member& member, shard::Shard::NodeChange&& change, std::uint64_t bytes, wire::Reply& reply) {
  const std::uint64_t before = member.shard->state_bytes();
  member.operators_made_for = 0.0;
  bytes += bytes_of_models(member.shard->pairs().size(), member.pairs.several());  // with the operators that go
  change_aside(member, bytes, [&] { member.shard->apply(std::move(change)); });
  metrics_.state_bytes += member.shard->state_bytes() - before;
  reply.body = wire::NodesChanged{.nodes = member.shard->nodes().size()};
}

void Service::register_nodes(Member& member, const wire::RegisterNodes& named, const Arrival& arrival,
                             wire::Reply& reply) {
  shard::Shard& shard = *member.shard;
  const wire::Batch& batch = arrival.request.batch;
  std::span<const std::uint64_t> ids;
  aside(bytes_of_nodes(batch), [&] { ids = check_new_nodes(batch, shard.nodes()); });
  check_owners(member.domain_it_is_in(), &member, kNoneWithdrawn, ids);
  NewNodes nodes;
  std::uint64_t grown = 0;
  aside(bytes_of_nodes(batch) + bytes_of_models(ids.size(), member.pairs.several()), [&] {
    nodes = new_nodes(batch, named.pairs, member.pairs, shard.pairs());
    grown = shard.bytes_with(ids.size(), nodes.of()) - shard.state_bytes();
  });
  const std::size_t after = shard.nodes().size() + ids.size();
  check_memory(grown, after, arrival.caller, member.identity);
  shard::Shard::NodeChange change;
  aside(bytes_of_lists(after) + grown, [&] { change = shard.adding(ids, nodes.temperatures, nullptr, nodes.of()); });
  check_memory(grown, after, arrival.caller, member.identity);  // once more: others have been answered meanwhile
  journal(arrival, member.id, &member);
  apply(member, std::move(change), bytes_of_lists(after), reply);
  metrics_.nodes += ids.size();
}

void Service::retire_nodes(Member& member, const wire::RetireNodes& /*asked*/, const Arrival& arrival,
                           wire::Reply& reply) {
  shard::Shard& shard = *member.shard;
  shard::Rows rows;
  shard::Shard::NodeChange change;
  aside(bytes_of_lists(shard.nodes().size()), [&] {
    rows = check_leaving_nodes(arrival.request.batch, shard.nodes());
    change = shard.removing(rows.slots);
  });
  const std::uint64_t moved = 2 * kept_bytes(shard, rows.slots.size());
  aside(moved, [] {});
  journal(arrival, member.id, &member);
  apply(member, std::move(change), moved, reply);
  metrics_.nodes -= rows.slots.size();
}

void Service::offer_nodes(Member& member, const wire::OfferNodes& offer, const Arrival& arrival, wire::Reply& reply) {
  shard::Shard& shard = *member.shard;
  const wire::Batch& batch = arrival.request.batch;
  check_in_domain(member.domain);
  check_transfer_id(offer.transfer_id);
  if (transfers_.contains(offer.transfer_id))
    refuse(Code::kInvalidValue, "offer_nodes.transfer_id", "an offer with this transfer_id waits already",
           "Draw a new one for every offer.");
  if (const auto waiting = offers_of(member).size(); waiting >= wire::kMaxOffers)
    refuse(Code::kLimit, "", fmt::format("{} offers of the session wait, the most it may have", waiting),
           "Wait until some are accepted, or offer more nodes at once.");
  shard::Rows rows;
  aside(bytes_of_lists(shard.nodes().size()), [&] { rows = check_leaving_nodes(batch, shard.nodes()); });
  const auto ids = batch.u64(Field::kNodeId);
  const std::uint64_t moved = kept_bytes(shard, ids.size());
  check_memory(moved, ids.size(), arrival.caller, member.identity);
  shard::States states;
  shard::Shard::NodeChange change;
  aside(bytes_of_lists(shard.nodes().size()) + moved, [&] {
    states = shard.states_of(rows.slots, false);
    change = shard.removing(rows.slots);
  });
  check_memory(moved, ids.size(), arrival.caller, member.identity);  // once more
  std::map<wire::TransferId, TransferPtr> made;
  made.emplace(offer.transfer_id, std::make_shared<const store::TransferImage>(
                                      store::TransferImage{.id = offer.transfer_id,
                                                           .giver = member.id,
                                                           .sequence = arrival.request.sequence,
                                                           .identity = member.identity,
                                                           .domain = member.domain,
                                                           .layers = std::string(layers_of(member.scene)),
                                                           .node_ids = {ids.begin(), ids.end()},
                                                           .states = std::move(states)}));
  journal(arrival, member.id, &member);
  apply(member, std::move(change), 2 * moved, reply);
  metrics_.state_bytes += kept_bytes(made.begin()->second->states);
  transfers_.merge(made);
}

void Service::accept_nodes(Member& member, const wire::AcceptNodes& accept, const Arrival& arrival,
                           wire::Reply& reply) {
  shard::Shard& shard = *member.shard;
  check_in_domain(member.domain);
  check_transfer_id(accept.transfer_id);
  const auto found = transfers_.find(accept.transfer_id);
  if (found == transfers_.end() || Domain{found->second->identity, found->second->domain} != member.domain_it_is_in())
    refuse(Code::kUnknownTransfer, "accept_nodes.transfer_id",
           fmt::format("no offer with this transfer_id waits in domain \"{}\"", printable(member.domain)),
           "It was accepted or withdrawn, or not made yet: the giver's offer must be answered first.");
  const store::TransferImage& transfer = *found->second;
  if (transfer.layers != layers_of(member.scene))
    refuse(Code::kOtherScene, "",
           fmt::format("the nodes were offered by session {}, whose scene differs from this session's",
                       short_name(transfer.giver)),
           "Accept them in a session of the same scene; `effective_scene` of both openings tells what differs.");
  if (shard::checks_closure(transfer.states) != shard.check_closure())
    refuse(Code::kOtherScene, "",
           fmt::format("session {}, which offered the nodes, {} closure, and this session does {}",
                       short_name(transfer.giver), shard.check_closure() ? "does not check" : "checks",
                       shard.check_closure() ? "" : "not"),
           "Open all sessions of the domain with the same open_session.check_closure.");
  if (!SessionPairs::same_columns(transfer.states, shard.pairs()))
    refuse(Code::kOtherScene, "",
           fmt::format("session {}, which offered the nodes, has other parameters than this session",
                       short_name(transfer.giver)),
           "Open all sessions of the domain with the same open_session.parameters.");
  const std::size_t after = shard.nodes().size() + transfer.node_ids.size();
  check_session_size(after);
  std::optional<shard::PairsOfNodes> pairs;
  std::uint64_t grown = 0;
  aside(bytes_of_models(transfer.node_ids.size(), member.pairs.several()), [&] {
    if (member.pairs.several()) pairs = member.pairs.of_states(transfer.states, shard.pairs());
    grown = shard.bytes_with(transfer.node_ids.size(), pairs ? &*pairs : nullptr) - shard.state_bytes();
  });
  const std::uint64_t freed = kept_bytes(transfer.states);
  const auto check_room = [&] {
    check_memory(grown > freed ? grown - freed : 0, after, arrival.caller, member.identity);
  };
  check_room();
  shard::Shard::NodeChange change;
  aside(bytes_of_lists(after) + grown + freed, [&] {
    const std::vector<double> initial(transfer.node_ids.size(), shard.model().options().initial_temperature);
    change = shard.adding(transfer.node_ids, initial, &transfer.states, pairs ? &*pairs : nullptr);
    reply.batch = node_column(transfer.node_ids);
  });
  check_room();  // once more: others have been answered meanwhile
  journal(arrival, member.id, &member);
  apply(member, std::move(change), bytes_of_lists(after), reply);
  metrics_.state_bytes -= freed;
  auto gone = transfers_.extract(found);
  change_aside(member, freed, [&] { gone = {}; });
}

std::vector<wire::TransferId> Service::offers_of(const Member& member) const {
  std::map<std::uint64_t, wire::TransferId> oldest_first;
  for (const auto& [id, transfer] : transfers_)
    if (transfer->giver == member.id) oldest_first.emplace(transfer->sequence, id);
  std::vector<wire::TransferId> offers;
  offers.reserve(oldest_first.size());
  for (const auto& [sequence, id] : oldest_first) offers.push_back(id);
  return offers;
}

// Drops the offers of a domain if none of its sessions is open.
void Service::forget_transfers_of(const Domain& domain) {
  const auto open = [&](const auto& entry) { return entry.second->shard && entry.second->domain_it_is_in() == domain; };
  if (domain.name.empty() || std::ranges::any_of(members_, open)) return;
  std::erase_if(transfers_, [&](const auto& entry) {
    const store::TransferImage& transfer = *entry.second;
    if (Domain{transfer.identity, transfer.domain} != domain) return false;
    log(fmt::format("WARNING: domain {} ends with {} that session {} offered", printable(transfer.domain),
                    wire::counted(transfer.node_ids.size(), "node"), short_name(transfer.giver)));
    metrics_.nodes -= transfer.node_ids.size();
    metrics_.state_bytes -= kept_bytes(transfer.states);
    return true;
  });
}

}  // namespace shearbus::service
