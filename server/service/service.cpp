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
  return wire::hexadecimal(std::span(id).first(4));
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
  if (replaying_ && !line.starts_with("ALARM")) return;  // it was told when the request first ran
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
  wire::ServerStatus& asking = user(caller.identity).counted;
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

// Recycles the memory of a reply that was sent, unless a socket still needs it.
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
  Arrival arrival{.frames = frames, .caller = caller};
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
      arrival.sum = wire::decode(frames, request, wire::PayloadSum::kLeftOut);
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
    refuse(Code::kNotPermitted, "",
           fmt::format("{} was taken off the server's list of authorised keys, or has another role there "
                       "since this connection was made",
                       caller.identity),
           "Ask the operator of the server for access. With another role, connect again.");
  if (shutting_down_) refuse(Code::kShuttingDown, "", "the server is stopping", "Connect to another server.");

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
    refuse(Code::kSuperseded, "", "the session was resumed since by a client that showed its token",
           "Leave it to that one.");
  refuse(Code::kEpoch, "",
         fmt::format("the request is for server epoch {:016x}; this is {:016x}: the server was restarted{}",
                     request.epoch, epoch_, member != nullptr ? "" : " and holds none of the earlier states"),
         member != nullptr ? "Resume the session, which tells where it stands, and go on from there."
                           : "Its layers are gone: begin the run anew with a new session. With a state directory a "
                             "server keeps them.");
}

Service::ReplyPtr Service::repeat(ReplyPtr kept) {
  ++metrics_.replayed;
  make_repeat(*kept);
  return kept;
}

Service::Member& Service::open_member(const wire::SessionId& id) const {
  const auto found = members_.find(id);
  if (found == members_.end())
    refuse(Code::kUnknownSession, "",
           fmt::format("no session has this id{}",
                       store_ == nullptr ? ": this server keeps none after its end (it has no state directory)"
                                         : " in the state directory of this server"),
           "Give the server, or its state directory, with which the run was begun. A new session has cold layers: with "
           "it the run begins anew.");
  if (!found->second->shard)
    refuse(Code::kUnknownSession, "", "the session was closed, and a closed session has no layers",
           "A new session has cold layers: with it the run begins anew. A run that may go on later leaves its session "
           "open in place of closing it.");
  return *found->second;
}

// Checks that the caller opened the session or is an operator, by the authenticated identity (a key or a uid). The
// session id and the resume token prove nothing, because they may leak.
void Service::check_identity(const Member& member, const Caller& caller) const {
  if (caller.identity == member.identity || caller.is_operator || replaying_) return;
  log(fmt::format("REFUSED: {} asked for session {} of {}", caller.identity, short_name(member.id), member.identity));
  refuse(Code::kNotPermitted, "", fmt::format("the session was opened by another than {}", caller.identity),
         "Use the key, or the user, that opened it, or ask an operator.");
}

Service::ReplyPtr Service::answer_by_verb(Arrival& arrival, const ReplyPtr& reply) {
  const Verb& verb = verb_of(arrival.request);
  if (verb.of_operators) check_operator(arrival.caller);
  return verb.sequence ? answer_in_session(verb, arrival, reply) : verb.handler(*this, verb, nullptr, arrival, reply);
}

Service::ReplyPtr Service::hello(const wire::Hello& hello, Arrival& arrival, const ReplyPtr& reply) {
  const Caller& caller = arrival.caller;
  if (hello.oldest_major > wire::kProtocolMajor || hello.newest_major < wire::kProtocolMajor)
    refuse(Code::kVersion, "",
           fmt::format("the client speaks protocol {} to {}; this server speaks {}", hello.oldest_major,
                       hello.newest_major, wire::kProtocolMajor),
           "Use a client and a server of the same major version.");
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

Service::ReplyPtr Service::answer_in_session(const Verb& verb, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  const auto found = members_.find(request.session_id);
  if (found == members_.end()) {
    check_epoch(request, nullptr);
    refuse(Code::kUnknownSession, "", "no session has this id: it was never opened here, or closed long ago",
           "Open a session first.");
  }
  Member& member = *found->second;
  check_identity(member, arrival.caller);
  session::Verdict verdict = member.conversation.triage(request.sequence, arrival.hash);
  member.last_request_ns = arrival.started_ns;
  if (verdict.triage == session::Triage::kResend) {
    ++user(arrival.caller.identity).counted.replayed;
    return repeat(std::move(verdict.reply));  // whatever the request's epoch
  }
  check_epoch(request, &member);
  if (!member.shard)
    refuse(Code::kUnknownSession, "",
           "the session is closed" + (member.closed_because.empty() ? "" : ": " + member.closed_because),
           "Open a new session.");
  if (verdict.triage == session::Triage::kReject) {
    if (follows_running(member, arrival) && must_wait(member)) return reply;
    throw Error(std::move(verdict.status));
  }

  return verb.handler(*this, verb, &member, arrival, reply);
}

wire::ServerStatus Service::status() const {
  wire::ServerStatus status = with_server(metrics_);
  times_.put_into(status);
  if (store_ != nullptr) {
    const store::StoreCounters& counted = store_->counters();
    status.journal_records = counted.records;
    status.journal_bytes = counted.record_bytes;
    status.recovered_requests = counted.replayed;
    status.checkpoints = counted.checkpoints;
    status.checkpoints_failed = counted.checkpoints_failed;
    status.checkpoint_bytes = counted.checkpoint_bytes;
    if (last_checkpoint_ns_ != 0) status.checkpoint_age_ns = options_.now_ns() - last_checkpoint_ns_;
  }
  if (options_.complete_status) options_.complete_status(status);
  return status;
}

}  // namespace shearbus::service
