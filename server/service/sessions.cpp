// Sessions: opened, resumed by their client or a successor, and closed.
#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "proto/wire/codec.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/text.hpp"
#include "server/service/columns.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;
using wire::Field;

// Bytes that it takes to read and convert one of a scene: its time in that of memory.
constexpr std::uint64_t kBytesPerSceneByte = 256;
// The same of the model that a set of parameters needs.
constexpr std::uint64_t kBytesPerModel = std::uint64_t{256} << 10;

namespace {

// Takes the same time for equal and different tokens, so that the time gives no hint at a guessed token.
bool same_token(const wire::ResumeToken& a, const wire::ResumeToken& b) {
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned>(a[i] ^ b[i]);
  return difference == 0;
}

}  // namespace

std::uint64_t bytes_of_nodes(const wire::Batch& batch) {
  return kBytesPerId * batch.u64(Field::kNodeId).size();
}

std::uint64_t bytes_of_models(std::size_t nodes, bool several) {
  return several ? kBytesPerModel * std::min(nodes, wire::kMaxParameterSets) : 0;
}

bool Service::being_opened(const wire::SessionId& session) {
  const auto opens = [&](const auto& request) { return request.get() != turn_of_ && request->opens == session; };
  if (std::ranges::none_of(long_, opens)) return false;
  turn_ = Turn::kWaiting;
  return true;
}

// Refuses a new session before its scene and nodes are read.
void Service::check_may_open(const wire::Request& request) const {
  check_epoch(request, nullptr);
  if (request.sequence != 0)
    refuse(Code::kSequenceGap, "",
           fmt::format("open_session has sequence {}; it is number 0 of its session", request.sequence),
           "Send it with sequence 0.");
  if (draining_ && !replaying_)
    refuse(Code::kDraining, "", "the server takes no new sessions: it will end when those it has are closed",
           "Open the session on another server.");
  if (metrics_.sessions >= options_.max_sessions)
    refuse(Code::kLimit, "", fmt::format("{} sessions are open, the most this server holds", metrics_.sessions),
           "Close sessions that are no longer used.");
}

Service::ReplyPtr Service::open_session(const wire::OpenSession& open, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  reply->session_id = open.session_id;
  if (open.session_id == wire::SessionId{})
    refuse(Code::kInvalidValue, "session_id", "session_id is all zero; expected 16 random bytes",
           "Draw them from the system's random source.");
  if (const auto known = members_.find(open.session_id); known != members_.end()) {
    check_identity(*known->second, arrival.caller);
    session::Verdict verdict = known->second->conversation.triage(request.sequence, arrival.hash);
    if (verdict.triage == session::Triage::kReject) throw Error(std::move(verdict.status));
    if (verdict.triage == session::Triage::kProcess)
      refuse(Code::kSequenceReused, "", "the session is open already", "");
    ++user(arrival.caller.identity).counted.replayed;
    return repeat(std::move(verdict.reply));
  }
  check_may_open(request);
  check_session_quota(arrival.caller);
  if (being_opened(open.session_id) || must_wait_for_domain(arrival.caller.identity, open.domain)) return reply;
  std::span<const std::uint64_t> node_ids;
  SceneModel made;
  aside(bytes_of_nodes(request.batch) + kBytesPerSceneByte * open.scene.size(), [&] {
    node_ids = check_opening_nodes(request.batch, open.domain);
    made = scene_model(open.scene, open.scene_file.empty() ? "scene" : open.scene_file);
  });
  check_owners({arrival.caller.identity, open.domain}, nullptr, kNoneWithdrawn, node_ids);
  check_work_budget(made.options);
  SessionPairs pairs;
  NewNodes nodes;
  std::unique_ptr<shard::Shard> shard_made;
  std::uint64_t wanted = 0;
  const bool several = !made.pairs.empty() || !open.parameters.empty();
  aside(kBytesPerSceneByte * open.scene.size() + bytes_of_models(node_ids.size(), several), [&] {
    pairs = SessionPairs(made, open.parameters);
    shard::PairTable table = pairs.table(made.options);
    nodes = new_nodes(request.batch, open.pairs, pairs, table);
    shard_made = make_shard(std::move(table), open.check_closure, made.friction_energy);
    wanted = shard_made->bytes_with(node_ids.size(), nodes.of());
  });
  check_memory(wanted, node_ids.size(), arrival.caller, arrival.caller.identity);
  aside(wanted, [&] { shard_made->apply(shard_made->adding(node_ids, nodes.temperatures, nullptr, nodes.of())); });
  check_may_open(request);  // once more: others have been answered meanwhile
  check_session_quota(arrival.caller);
  check_memory(wanted, node_ids.size(), arrival.caller, arrival.caller.identity);

  auto member = std::make_unique<Member>();
  member->id = open.session_id;
  member->identity = arrival.caller.identity;
  member->owner_epoch = epoch_;
  member->opened_ns = member->last_request_ns = arrival.started_ns;
  member->resume_token = open.resume_token;
  member->domain = open.domain;
  member->scene_name = std::move(made.name);
  member->scene = std::move(made.effective);
  member->idle_limit_s = open.idle_limit_s;
  member->shard = std::move(shard_made);
  member->pairs = std::move(pairs);
  auto& body = reply->body.emplace<wire::SessionOpened>(opened(*member));
  std::ranges::copy(member->pairs.unusual_columns(request.batch), std::back_inserter(body.warnings));
  member->conversation.complete(0, arrival.hash, reply);
  const shard::Shard& shard = *member->shard;
  const std::string line =
      fmt::format("session {} opened by {}: \"{}\"{}{}, {}, {} B each", short_name(open.session_id), member->identity,
                  printable(member->scene_name), open.domain.empty() ? "" : ", domain ", printable(open.domain),
                  wire::counted(shard.nodes().size(), "node"), body.bytes_per_node);
  const std::uint64_t state_bytes = shard.state_bytes();
  Members made_member;
  made_member.emplace(open.session_id, std::move(member));
  journal(arrival, open.session_id, nullptr);
  members_.merge(made_member);
  ++metrics_.sessions;
  metrics_.nodes += node_ids.size();
  metrics_.state_bytes += state_bytes;
  log(line);
  return reply;
}

// A shard without nodes.
std::unique_ptr<shard::Shard> Service::make_shard(shard::PairTable pairs, bool check_closure, bool sum_energy) const {
  return std::make_unique<shard::Shard>(
      std::move(pairs), pool_,
      shard::ShardOptions{
          .nodes_per_task = options_.nodes_per_task, .check_closure = check_closure, .sum_energy = sum_energy});
}

std::unique_ptr<shard::Shard> Service::restored_shard(const SessionPairs& pairs, shard::PairTable table,
                                                      const std::vector<std::uint64_t>& node_ids,
                                                      const shard::States& states) const {
  auto shard = make_shard(std::move(table), shard::checks_closure(states), shard::sums_energy(states));
  const auto of_nodes = pairs.several() ? std::optional(pairs.of_states(states, shard->pairs())) : std::nullopt;
  const std::vector<double> temperatures(node_ids.size(), shard->model().options().initial_temperature);
  shard->apply(shard->adding(node_ids, temperatures, nullptr, of_nodes ? &*of_nodes : nullptr));
  return shard;
}

Service::NewNodes Service::new_nodes(const wire::Batch& batch, std::span<const std::string> named,
                                     const SessionPairs& pairs, const shard::PairTable& known) {
  NewNodes nodes;
  if (pairs.several())
    nodes.pairs = pairs.of_new_nodes(batch, named, known);
  else
    refuse_pair_columns(batch, named.size());
  nodes.temperatures = check_initial_temperatures(batch, known.model(0).options(), nodes.of());
  return nodes;
}

wire::SessionOpened Service::opened(const Member& member) const {
  const physics::Model& model = member.shard->model();
  const wire::StrategyColumns& columns = wire::columns_of(strategy_of(model.options()));
  std::vector<Field> reply_columns = columns_met(columns.reply, *member.shard);
  std::vector<std::string> warnings = model.warnings();
  std::ranges::copy(member.pairs.warnings(), std::back_inserter(warnings));
  std::uint64_t reply_row = 0;
  for (const Field field : reply_columns) reply_row += wire::size_of(wire::element_of(field));
  return {.effective_scene = member.scene,
          .bytes_per_node = member.shard->bytes_per_node() + reply_row,
          .warnings = std::move(warnings),
          .strategy = strategy_of(model.options()),
          .tangential_components = static_cast<std::uint32_t>(model.options().tangential_components),
          .required_columns = columns_met(columns.required, *member.shard),
          .optional_columns = columns_met(columns.optional, *member.shard),
          .reply_columns = std::move(reply_columns),
          .columns_on_request = columns_met(columns.on_request, *member.shard),
          .scene_name = member.scene_name,
          .pairs = member.pairs.names(),
          .parameters = member.pairs.parameters()};
}

// What was granted once is in the journal and is granted again by every server that replays it.
void Service::check_work_budget(const physics::ModelOptions& options) const {
  if (replaying_ || options_.max_work_budget == 0.0 || options.work_budget <= options_.max_work_budget) return;
  refuse(Code::kLimit, "work_budget",
         fmt::format("work_budget = {:g}: this server grants at most {:g} evaluations for a node's step",
                     options.work_budget, options_.max_work_budget),
         "Ask for less, or have the server started with a larger --max-work-budget.");
}

// Lets the claimant own the session. The claim is journaled, so that the clients before it stay superseded after a
// restart. Its record has the granted epoch as its sequence.
void Service::grant(Member& member, const wire::ResumeSession& resume, const Arrival& arrival) {
  constexpr std::size_t kMostRemembered = 32;
  std::vector<std::uint64_t> superseded = member.superseded;
  for (const std::uint64_t epoch : {member.owner_epoch, epoch_})
    if (epoch != 0 && std::ranges::find(superseded, epoch) == superseded.end()) superseded.push_back(epoch);
  if (superseded.size() > kMostRemembered) superseded.erase(superseded.begin(), superseded.end() - kMostRemembered);
  const std::uint64_t granted = replaying_ ? granted_epoch_ : epoch_ + claims_ + 1;
  journal(arrival, member.id, &member, granted);
  ++claims_;
  member.superseded = std::move(superseded);
  member.claim = resume.claim;
  member.claimant = resume.claimant;
  member.epoch = member.owner_epoch = granted;
}

Service::ReplyPtr Service::resume(const wire::ResumeSession& resume, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  Member& member = open_member(request.session_id);
  check_identity(member, arrival.caller);
  if (must_wait(member)) return reply;
  if (member.resume_token == wire::ResumeToken{} || !same_token(member.resume_token, resume.resume_token))
    refuse(Code::kResumeRefused, "", "the resume token is not the one the session was opened with",
           "Only the client that opened the session, or one it gave its token, may resume it.");
  // A claim is repeated only within the epoch of the server that granted it.
  const bool repeated = member.epoch != 0 && resume.claim == member.claim && resume.claimant == member.claimant;
  if (resume.claim != 0 && !repeated) {
    if (request.epoch != epoch_)
      refuse(Code::kEpoch, "",
             fmt::format("the claim is for server epoch {:016x}; this is {:016x}", request.epoch, epoch_),
             "Ask where the session stands, and claim it with the epoch and number of that reply.");
    if (resume.claim != member.claim + 1)
      refuse(Code::kSuperseded, "",
             fmt::format("claim {} of the session, after claim {} was granted", resume.claim, member.claim),
             "Ask where the session stands, and claim it if its client is known to be gone.");
  }
  hold(member);
  const shard::Shard& shard = *member.shard;
  aside(64 * shard.nodes().size(), [&] { reply->batch = member.pairs.columns_of_nodes(shard); });
  if (resume.claim != 0 && !repeated) {
    const std::string line = fmt::format("session {} resumed by {}: state version {}", short_name(member.id),
                                         arrival.caller.identity, shard.state_version());
    grant(member, resume, arrival);
    log(line);
  }
  reply->body = wire::SessionResumed{.session = opened(member),
                                     .last_sequence = member.conversation.last_sequence(),
                                     .state_version = shard.state_version(),
                                     .trial_stands = member.trial_stands(),
                                     .claim = member.claim,
                                     .offers = offers_of(member),
                                     .claimant = member.claimant};
  if (resume.claim != 0) reply->epoch = member.epoch;
  return reply;
}

// Closes each idle session by a request that the server makes itself, as an operator. The request is journaled, so a
// recovery closes the session again. After a recovery the time without a request counts from the recovery.
void Service::close_idle_sessions() noexcept try {
  std::vector<wire::Request> closings;
  for (const auto& [id, member] : members_) {
    if (!member->shard || member->running || member->long_request || member->idle_limit_s == 0) continue;
    const double idle_s = 1e-9 * static_cast<double>(options_.now_ns() - member->last_request_ns);
    if (idle_s < static_cast<double>(member->idle_limit_s)) continue;
    closings.push_back({.session_id = id,
                        .sequence = member->conversation.last_sequence() + 1,
                        .body = wire::CloseSession{.reason = fmt::format("idle for {:.0f} s, its client allowed {} s",
                                                                         idle_s, member->idle_limit_s)}});
  }
  for (const wire::Request& closing : closings) {
    const std::string header = wire::encode_header(closing);
    const std::span<const std::byte> frame = std::as_bytes(std::span(header));
    handle(Frames(&frame, 1), {.identity = "the server", .is_operator = true});
  }
} catch (const std::exception&) {  // no memory: a later call closes the sessions
}

void Service::close_session(Member& member, const wire::CloseSession& close, const Arrival& arrival,
                            wire::Reply& reply) {
  std::string because = printable(close.reason);
  const std::uint64_t held = member.held_bytes();
  aside(held, [] {});
  journal(arrival, member.id, &member);
  const wire::SessionClosed totals{.requests = member.requests + 1,  // counts close_session itself
                                   .node_steps = member.node_steps,
                                   .solver_ns = member.solver_ns,
                                   .asleep_node_steps = member.asleep_node_steps};
  log(fmt::format("session {} closed{}{}: {}, {}, {:.3f} s in the layers", short_name(member.id),
                  close.reason.empty() ? "" : ", ", printable(close.reason), wire::counted(totals.requests, "request"),
                  wire::counted(totals.node_steps, "node-step"), 1e-9 * static_cast<double>(totals.solver_ns)));
  std::deque<wire::SessionId>& closed = closed_[member.identity];
  closed.push_back(member.id);
  member.closed_because = std::move(because);
  reply.body = totals;
  --metrics_.sessions;
  metrics_.nodes -= member.shard->nodes().size();
  metrics_.state_bytes -= held;
  member.parts.reset();
  member.scene = {};
  member.superseded = {};
  std::vector<MarkPtr> marks = std::move(member.marks);
  std::unique_ptr<shard::Shard> shard = std::move(member.shard);
  forget_transfers_of(member.domain_it_is_in());
  change_aside(member, held, [&] {
    marks.clear();
    shard.reset();
  });
  if (closed.size() > kClosedSessionsKept && members_.at(closed.front())->long_request == nullptr) {
    members_.erase(closed.front());
    closed.pop_front();
  }
}

}  // namespace shearbus::service
