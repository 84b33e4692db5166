#include "server/service/service.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "proto/wire/codec.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/service/columns.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/validate.hpp"
#include "server/service/verb.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;
using wire::Field;

std::string short_name(const wire::SessionId& id) {
  return fmt::format("{:02x}{:02x}{:02x}{:02x}", id[0], id[1], id[2], id[3]);
}

// Bytes that it takes to read and convert one of a scene: its time in that of memory.
constexpr std::uint64_t kBytesPerSceneByte = 256;
// The same of the model that a set of parameters needs.
constexpr std::uint64_t kBytesPerModel = std::uint64_t{256} << 10;

std::uint64_t bytes_of_nodes(const wire::Batch& batch) {
  constexpr std::uint64_t kBytesPerNode = 64;  // to sort and compare an id
  return kBytesPerNode * batch.u64(Field::kNodeId).size();
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

std::string printable(const std::string& text) {
  constexpr std::size_t kLongest = 80;
  return wire::printable(text, kLongest);
}

Service::Service(ServiceOptions options, shard::TaskPool& pool, store::Store* store)
    : options_(std::move(options)), pool_(pool), store_(store), epoch_(options_.epoch) {
  started_ns_ = options_.now_ns();
}

Service::~Service() {
  give_up();
}

// Writes a line of the log. A line that cannot be written is lost.
void Service::log(const std::string& line) const noexcept try {
  if (options_.log) options_.log(line);
} catch (const std::exception&) {
}

std::optional<ReplyFrames> Service::handle(Frames frames, const Caller& caller, Turn* turn) noexcept try {
  if (turn != nullptr) *turn = Turn::kAnswered;
  if (failed()) return std::nullopt;
  constexpr std::size_t kLong = std::size_t{16} << 10;  // of shorter messages all but steps are measured below
  std::optional<Longest> measured;
  if (frames.size() > 1 && frames[1].size() > kLong) measured.emplace(options_.cpu_ns, metrics_.longest_turn_ns);
  may_wait_ = turn != nullptr;
  turn_ = Turn::kAnswered;
  ++metrics_.requests;
  User& asking = user(caller.identity);
  ++asking.requests;
  ReplyPtr reply = blank_reply();
  reply->epoch = epoch_;
  journaled_now_ = false;
  current_ = {};
  try {
    reply = answer(frames, caller, reply);
    if (std::exchange(journaled_now_, false)) settle();
  } catch (const Error& error) {
    reply->status = error.status();
  } catch (const std::exception& fault) {
    reply->status = {.code = Code::kInternal,
                     .text = fmt::format("the server could not run the request: {}", fault.what()),
                     .remedy = "Nothing was changed. Tell the maintainers of the server."};
  }
  if (turn_ != Turn::kAnswered) {
    --metrics_.requests;
    --asking.requests;
    *turn = turn_;
    return std::nullopt;
  }
  if (journaled_now_) failed_ = true;  // the request is in the journal but has not run: states and journal differ
  if (failed()) {
    log(fmt::format("FAILED: {}: {}", wire::name(reply->status.code), reply->status.text));
    return std::nullopt;
  }
  if (!reply->status.ok()) {
    ++metrics_.refused;
    ++asking.refused;
    if (const auto code = static_cast<std::size_t>(reply->status.code); code < Metrics::kCodes) ++times_.refusals[code];
    reply->body = std::monostate{};
    reply->batch = wire::Batch();
  }
  ReplyFrames sent;
  sent.header = wire::encode_header(*reply, {}, current_.sum);
  sent.has_payload = !reply->batch.columns().empty();
  sent.payload = reply->batch.bytes();
  sent.owner = std::move(reply);
  if (options_.exchanged) options_.exchanged(frames, sent);
  if (current_.started_ns != 0) times_.requests[current_.verb].add(options_.now_ns() - current_.started_ns);
  return sent;
} catch (const std::exception&) {
  failed_ = failed_ || journaled_now_;
  return std::nullopt;
}

Service::ReplyPtr Service::blank_reply() {
  if (!used_reply_) return std::make_shared<wire::Reply>();
  *used_reply_ = {};
  return std::exchange(used_reply_, nullptr);
}

// Keeps the memory of a reply that was sent, unless a socket still needs it.
void Service::recycle(ReplyPtr reply) noexcept {
  if (!reply || reply.use_count() != 1) return;
  // The last other owner may have been a thread of libzmq: to give up a copy orders its reads before what is written
  // here, which use_count() does not.
  ReplyPtr(reply).reset();
  if (!reply->batch.columns().empty()) used_batch_ = std::move(reply->batch);
  used_reply_ = std::move(reply);
}

void Service::recycle(std::unique_ptr<RunningStep> step) noexcept {
  step->clear();
  used_step_ = std::move(step);
}

void Service::settle() {
  if (store_->durability() == store::Durability::kPower)
    timed(options_.now_ns, times_.journal_sync, [&] { store_->settle(); });
  else
    store_->settle();
}

// Decodes the request and calls the function of its verb. Returns `reply`, or the kept reply of a repeated request.
Service::ReplyPtr Service::answer(Frames frames, const Caller& caller, const ReplyPtr& reply) {
  Arrival arrival{.frames = frames, .caller = caller, .request = {}, .hash = 0, .started_ns = 0};
  wire::Request& request = arrival.request;
  const auto address = [&](const wire::Request& asked) {
    reply->request_id = asked.request_id;
    reply->session_id = asked.session_id;
    reply->sequence = asked.sequence;
  };
  if (Member* const member = computed_for(frames)) {
    address(member->running->request);
    return end_step(*member, arrival);
  }
  if (LongRequest* const again = asked_again(frames)) {
    address(again->arrival.request);
    if (!again->task->ended()) {
      turn_ = Turn::kComputing;
      return reply;
    }
    if (ReplyPtr ended = end_long(*again)) return ended;
  }
  try {
    if (caller.in_process)
      arrival.sum = wire::decode_trusted(frames, request);
    else
      wire::decode(frames, request);
  } catch (const Error&) {
    address(request);  // so that the refusal has the session and request ids that could be read
    throw;
  }
  address(request);
  std::optional<Longest> measured;
  if (!std::holds_alternative<wire::Downscale>(request.body))
    measured.emplace(options_.cpu_ns, metrics_.longest_turn_ns);
  arrival.started_ns = options_.now_ns();
  current_ = {.verb = request.body.index(), .started_ns = arrival.started_ns, .sum = arrival.sum};
  if (caller.is_revoked)
    throw Error({.code = Code::kNotPermitted,
                 .text = fmt::format("{} was taken off the server's list of authorised keys, or has another role there "
                                     "since this connection was made",
                                     caller.identity),
                 .remedy = "Ask the operator of the server for access. With another role, connect again."});
  if (shutting_down_)
    throw Error(
        {.code = Code::kShuttingDown, .text = "the server is stopping", .remedy = "Connect to another server."});

  // The header holds the sum of the payload, which decode() has compared, so the hash of the header identifies the whole
  // request. A client in this process that leaves out the sum gives each content a request_id of its own.
  arrival.hash = wire::hash_of(frames.first(1));
  return answer_in_turn(arrival, reply);
}

// Checks the epoch of a request; `member` is null if the session of the request is unknown. Accepts a request that is
// replayed from the journal, because it was checked when it first ran.
void Service::check_epoch(const wire::Request& request, const Member* member) const {
  const std::uint64_t expected = member != nullptr && member->epoch != 0 ? member->epoch : epoch_;
  if (request.epoch == 0 || request.epoch == expected || replaying_) return;
  const bool superseded =
      member != nullptr && std::ranges::find(member->superseded, request.epoch) != member->superseded.end();
  if (superseded || request.epoch - epoch_ <= claims_)
    throw Error({.code = Code::kSuperseded,
                 .text = "the session was resumed since by a client that showed its token",
                 .remedy = "Leave it to that one."});
  throw Error(
      {.code = Code::kEpoch,
       .text = fmt::format("the request is for server epoch {:016x}; this is {:016x}: the server was restarted{}",
                           request.epoch, epoch_, member != nullptr ? "" : " and holds none of the earlier states"),
       .remedy = member != nullptr ? "Resume the session, which tells where it stands, and go on from there."
                                   : "Open a new session and start again from the host's last restart point."});
}

Service::ReplyPtr Service::repeat(ReplyPtr kept) {
  ++metrics_.replayed;
  make_repeat(*kept);
  return kept;
}

// Checks that the caller opened the session or is an operator, by the authenticated identity (a key or a uid). The
// session id and the resume token prove nothing, because they may leak.
void Service::check_identity(const Member& member, const Caller& caller) const {
  if (caller.identity == member.identity || caller.is_operator || replaying_) return;
  log(fmt::format("REFUSED: {} asked for session {} of {}", caller.identity, short_name(member.id), member.identity));
  throw Error({.code = Code::kNotPermitted,
               .text = fmt::format("the session was opened by another than {}", caller.identity),
               .remedy = "Use the key, or the user, that opened it, or ask an operator."});
}

Service::ReplyPtr Service::answer_by_verb(Arrival& arrival, const ReplyPtr& reply) {
  const Verb& verb = verb_of(arrival.request);
  if (verb.of_operators) check_operator(arrival.caller);
  return verb.sequence ? answer_in_session(verb, arrival, reply) : verb.handler(*this, verb, nullptr, arrival, reply);
}

Service::ReplyPtr Service::hello(const wire::Hello& hello, Arrival& arrival, const ReplyPtr& reply) {
  const Caller& caller = arrival.caller;
  if (hello.oldest_major > wire::kProtocolMajor || hello.newest_major < wire::kProtocolMajor)
    throw Error({.code = Code::kVersion,
                 .text = fmt::format("the client speaks protocol {} to {}; this server speaks {}", hello.oldest_major,
                                     hello.newest_major, wire::kProtocolMajor),
                 .remedy = "Use a client and a server of the same major version."});
  check_printable(hello.client_name, "hello.client_name");
  wire::Welcome welcome;
  welcome.server_version = options_.server_version;
  welcome.limits.max_sessions = options_.max_sessions;
  welcome.limits.max_state_bytes = options_.max_state_bytes;
  welcome.limits.max_sessions_per_user = caller.is_operator ? options_.max_sessions : options_.max_sessions_per_user;
  welcome.limits.max_state_bytes_per_user =
      caller.is_operator ? options_.max_state_bytes : options_.max_state_bytes_per_user;
  if (store_ != nullptr) welcome.limits.max_replay_work = static_cast<std::uint64_t>(store_->checkpoint_work());
  welcome.limits.max_work_budget = static_cast<std::uint64_t>(options_.max_work_budget);
  welcome.access = caller.identity.substr(0, caller.identity.find(' '));
  welcome.capabilities = {"velocity_driven", "force_driven", "trial",      "resume",     "mark",       "domains",
                          "stick_form",      "absent_nodes", "closure",    "idle_limit", "parts",      "profiles",
                          "regimes",         "mean_stress",  "linearised", "pairs",      "parameters", "parts_ahead"};
  if (caller.is_operator) welcome.capabilities.emplace_back("operator");
  if (store_ != nullptr) welcome.durability = store::name(store_->durability());
  reply->body = std::move(welcome);
  return reply;
}

// Refuses a new session before its scene and nodes are read.
void Service::check_may_open(const wire::Request& request) const {
  check_epoch(request, nullptr);
  if (request.sequence != 0)
    throw Error({.code = Code::kSequenceGap,
                 .text = fmt::format("open_session has sequence {}; it is number 0 of its session", request.sequence),
                 .remedy = "Send it with sequence 0."});
  if (draining_ && !replaying_)
    throw Error({.code = Code::kDraining,
                 .text = "the server takes no new sessions: it will end when those it has are closed",
                 .remedy = "Open the session on another server."});
  if (metrics_.sessions >= options_.max_sessions)
    throw Error({.code = Code::kLimit,
                 .text = fmt::format("{} sessions are open, the most this server holds", metrics_.sessions),
                 .remedy = "Close sessions that are no longer used."});
}

Service::ReplyPtr Service::open_session(const wire::OpenSession& open, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  reply->session_id = open.session_id;
  if (open.session_id == wire::SessionId{})
    throw Error({.code = Code::kInvalidValue,
                 .text = "session_id is all zero; expected 16 random bytes",
                 .remedy = "Draw them from the system's random source.",
                 .field = "session_id"});
  if (const auto known = members_.find(open.session_id); known != members_.end()) {
    check_identity(*known->second, arrival.caller);
    session::Verdict verdict = known->second->conversation.triage(request.sequence, arrival.hash);
    if (verdict.triage == session::Triage::kReject) throw Error(std::move(verdict.status));
    if (verdict.triage == session::Triage::kProcess)
      throw Error({.code = Code::kSequenceReused, .text = "the session is open already"});
    ++user(arrival.caller.identity).replayed;
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
    shard_made = make_shard(std::move(table), open.check_closure);
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
  std::ranges::copy(member->pairs.unusual_parameters(request.batch), std::back_inserter(body.warnings));
  member->conversation.complete(0, arrival.hash, reply);
  const shard::Shard& shard = *member->shard;
  const std::string line =
      fmt::format("session {} opened by {}: \"{}\"{}{}, {} nodes, {} B each", short_name(open.session_id),
                  member->identity, printable(member->scene_name), open.domain.empty() ? "" : ", domain ",
                  printable(open.domain), shard.nodes().size(), shard.bytes_per_node());
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
std::unique_ptr<shard::Shard> Service::make_shard(shard::PairTable pairs, bool check_closure) const {
  return std::make_unique<shard::Shard>(
      std::move(pairs), std::span<const std::uint64_t>(), std::span<const std::uint32_t>(), std::span<const double>(),
      pool_, shard::ShardOptions{.nodes_per_task = options_.nodes_per_task, .check_closure = check_closure});
}

std::unique_ptr<shard::Shard> Service::restored_shard(const SessionPairs& pairs, shard::PairTable table,
                                                      const std::vector<std::uint64_t>& node_ids,
                                                      const shard::States& states) const {
  auto shard = make_shard(std::move(table), shard::checks_closure(states));
  const auto of_nodes = pairs.several() ? std::optional(pairs.of_states(states, shard->pairs())) : std::nullopt;
  const std::vector<double> temperatures(node_ids.size(), shard->model().options().initial_temperature);
  shard->apply(shard->adding(node_ids, temperatures, nullptr, of_nodes ? &*of_nodes : nullptr));
  return shard;
}

Service::NewNodes Service::new_nodes(const wire::Batch& batch, std::span<const std::string> named,
                                     const SessionPairs& pairs, const shard::PairTable& known) {
  NewNodes nodes;
  if (pairs.several()) {
    nodes.pairs = pairs.of_new_nodes(batch, named, known);
    nodes.temperatures = check_initial_temperatures(batch, *nodes.pairs);
  } else {
    refuse_pair_columns(batch, named.size());
    nodes.temperatures = check_initial_temperatures(batch, known.model(0).options());
  }
  return nodes;
}

wire::SessionOpened Service::opened(const Member& member) const {
  const physics::Model& model = member.shard->model();
  ModelColumns columns = columns_of(model.options());
  if (!member.shard->check_closure()) std::erase(columns.on_request, Field::kClosure);
  std::vector<std::string> warnings = model.warnings();
  std::ranges::copy(member.pairs.warnings(), std::back_inserter(warnings));
  std::uint64_t reply_row = 0;
  for (const Field field : columns.reply) reply_row += wire::size_of(wire::element_of(field));
  return {.effective_scene = member.scene,
          .bytes_per_node = member.shard->bytes_per_node() + reply_row,
          .warnings = std::move(warnings),
          .strategy = strategy_of(model.options()),
          .tangential_components = static_cast<std::uint32_t>(model.options().tangential_components),
          .required_columns = std::move(columns.required),
          .optional_columns = std::move(columns.optional),
          .reply_columns = std::move(columns.reply),
          .columns_on_request = std::move(columns.on_request),
          .scene_name = member.scene_name,
          .pairs = member.pairs.names(),
          .parameters = member.pairs.parameters()};
}

// What was granted once is in the journal and is granted again by every server that replays it.
void Service::check_work_budget(const physics::ModelOptions& options) const {
  if (replaying_ || options_.max_work_budget == 0.0 || options.work_budget <= options_.max_work_budget) return;
  throw Error({.code = Code::kLimit,
               .text = fmt::format("work_budget = {:g}: this server grants at most {:g} evaluations for a node's step",
                                   options.work_budget, options_.max_work_budget),
               .remedy = "Ask for less, or have the server started with a larger --max-work-budget.",
               .field = "work_budget"});
}

void Service::check_memory(std::uint64_t wanted, std::size_t nodes, const Caller& caller,
                           std::string_view owner) const {
  check_memory_quota(wanted, nodes, caller, owner);
  if (metrics_.state_bytes > options_.max_state_bytes || wanted > options_.max_state_bytes - metrics_.state_bytes)
    throw Error({.code = Code::kLimit,
                 .text = fmt::format("the states of {} nodes need {} MB; {} of {} MB are in use", nodes, wanted >> 20,
                                     metrics_.state_bytes >> 20, options_.max_state_bytes >> 20),
                 .remedy = "Use a graded grid with fewer cells, close sessions, or give the server more memory."});
}

Service::ReplyPtr Service::answer_in_session(const Verb& verb, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  const auto found = members_.find(request.session_id);
  if (found == members_.end()) {
    check_epoch(request, nullptr);
    throw Error({.code = Code::kUnknownSession,
                 .text = "no session has this id: it was never opened here, or closed long ago",
                 .remedy = "Open a session first."});
  }
  Member& member = *found->second;
  check_identity(member, arrival.caller);
  session::Verdict verdict = member.conversation.triage(request.sequence, arrival.hash);
  member.last_request_ns = arrival.started_ns;
  if (verdict.triage == session::Triage::kResend) {
    ++user(arrival.caller.identity).replayed;
    return repeat(std::move(verdict.reply));  // whatever the request's epoch
  }
  check_epoch(request, &member);
  if (!member.shard)
    throw Error({.code = Code::kUnknownSession,
                 .text = "the session is closed" + (member.closed_because.empty() ? "" : ": " + member.closed_because),
                 .remedy = "Open a new session."});
  if (verdict.triage == session::Triage::kReject) {
    if (follows_running(member, arrival) && must_wait(member)) return reply;
    throw Error(std::move(verdict.status));
  }

  return verb.handler(*this, verb, &member, arrival, reply);
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
  log(fmt::format("session {} closed{}{}: {} requests, {} node-steps, {:.3f} s in the layers", short_name(member.id),
                  close.reason.empty() ? "" : ", ", printable(close.reason), totals.requests, totals.node_steps,
                  1e-9 * static_cast<double>(totals.solver_ns)));
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

wire::ServerStatus Service::status() const {
  wire::ServerStatus status = metrics_;
  status.uptime_ns = options_.now_ns() - started_ns_;
  status.threads = pool_.threads();
  status.server_version = options_.server_version;
  status.draining = draining_;
  times_.put_into(status);
  if (store_ != nullptr) {
    const store::StoreCounters& kept = store_->counters();
    status.journal_records = kept.records;
    status.journal_bytes = kept.record_bytes;
    status.recovered_requests = kept.replayed;
    status.checkpoints = kept.checkpoints;
    status.checkpoints_failed = kept.checkpoints_failed;
    status.checkpoint_bytes = kept.checkpoint_bytes;
    if (last_checkpoint_ns_ != 0) status.checkpoint_age_ns = options_.now_ns() - last_checkpoint_ns_;
  }
  if (options_.complete_status) options_.complete_status(status);
  return status;
}

}  // namespace shearbus::service
