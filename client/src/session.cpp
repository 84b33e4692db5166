// How a session sends its requests: in the order of their sequence numbers, across restarts of the server, each until
// its reply has come.
#include "client/src/session.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <random>

#include "proto/wire/codec.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/xxh3.hpp"

namespace shearbus {
namespace {

constexpr std::chrono::milliseconds kStoppingPause{100};  // pause between two attempts while the server restarts
constexpr int kMostRestarts = 20;                         // restarts of the server that one call follows

}  // namespace

std::array<std::uint8_t, 16> random_bytes() {
  std::random_device source;
  std::array<std::uint8_t, 16> bytes;
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(source());
  return bytes;
}

std::uint64_t hash_of(const wire::Request& request, wire::PayloadSum sum) {
  const std::string header = wire::encode_header(request, {}, sum);
  const std::array<std::span<const std::byte>, 1> bytes = {std::as_bytes(std::span(header))};
  return wire::hash_of(bytes);
}

Received ask(Connection& connection, wire::Request request) {
  request.request_id = connection.next_request_id();
  return connection.call(request, connection.options().reply_deadline);
}

Received repeat_claim(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token,
                      ClaimInDoubt& in_doubt) {
  const wire::ResumeSession claim{.resume_token = token, .claim = in_doubt.number, .claimant = connection.claimant()};
  try {
    Received granted = ask(connection, {.session_id = id, .epoch = in_doubt.epoch, .body = claim});
    in_doubt = {};
    return granted;
  } catch (const Error& fault) {
    if (fault.status().code == Code::kSuperseded) in_doubt = {};  // no server will grant it
    throw;
  }
}

Received claim_session(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token,
                       ClaimInDoubt& in_doubt, bool after_own) {
  for (int restarts = 0;; ++restarts) {
    Received asked = ask(connection, {.session_id = id, .body = wire::ResumeSession{.resume_token = token}});
    const auto& position = body_of<wire::SessionResumed>(asked);
    if (after_own && position.claimant != connection.claimant()) {
      in_doubt = {};
      throw Error({.code = Code::kSuperseded, .text = "the last claim of the session is another client's"});
    }
    in_doubt = {.number = position.claim + 1, .epoch = asked.reply.epoch};
    try {
      return repeat_claim(connection, id, token, in_doubt);
    } catch (const Error& fault) {
      // EPOCH means that the server was restarted between asking for the session's position and claiming it.
      if (fault.status().code != Code::kEpoch || restarts == kMostRestarts) throw;
    }
  }
}

wire::Request SessionState::next_request() const {
  wire::Request request;
  request.session_id = id;
  request.epoch = in_doubt ? in_doubt->epoch : epoch;
  request.sequence = last_sequence + 1;
  request.request_id = in_doubt ? in_doubt->request_id : 0;
  return request;
}

// A request that repeats one of unknown outcome has its id. With another payload it is another request, which the server
// could not tell by a header without a sum.
void SessionState::give_id(wire::Request& request) {
  const bool other =
      in_doubt && request.request_id == in_doubt->request_id && wire::xxh3(request.batch.bytes()) != in_doubt->payload;
  if (request.request_id == 0 || other) request.request_id = connection->next_request_id();
}

void SessionState::keep_in_doubt(const wire::Request& request) noexcept {
  in_doubt = InDoubt{request.request_id, request.epoch, wire::xxh3(request.batch.bytes())};
}

Received SessionState::exchange(wire::Request& request) {
  give_id(request);
  try {
    Received received = call(request);
    adopt(request, received);
    in_doubt.reset();
    last_sequence = request.sequence;
    return received;
  } catch (const Error& fault) {
    // Codes 4xx mean "not now": after such a refusal the server may still run a second copy of the request that is on
    // its way.
    const bool not_now = static_cast<int>(fault.status().code) / 100 == 4;
    if (fault.status().code == Code::kUnknownOutcome || not_now)
      keep_in_doubt(request);
    else if (fault.status().code != Code::kUnreachable && fault.status().code != Code::kAuth)
      in_doubt.reset();
    if (fault.status().code == Code::kSequenceReused) resynchronise();
    throw;
  } catch (...) {  // such as std::bad_alloc, before or after the request was sent
    keep_in_doubt(request);
    throw;
  }
}

void change_nodes(std::vector<std::uint64_t>& node_ids, const wire::Request& request, const Batch& answer) {
  const auto named = request.batch.u64(Field::kNodeId), answered = answer.u64(Field::kNodeId);
  if (asks<wire::Rollback>(request)) {
    node_ids.assign(answered.begin(), answered.end());
  } else if (asks<wire::RetireNodes, wire::OfferNodes>(request)) {
    std::vector<std::uint64_t> gone(named.begin(), named.end());
    std::ranges::sort(gone);
    std::erase_if(node_ids, [&](std::uint64_t node) { return std::ranges::binary_search(gone, node); });
  } else {
    const auto come = asks<wire::RegisterNodes>(request) ? named : answered;
    node_ids.insert(node_ids.end(), come.begin(), come.end());
  }
}

void SessionState::adopt(const wire::Request& request, Received& received) {
  if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
    const std::uint64_t nodes = body_of<wire::Upscale>(received).nodes;
    if (step->parts != 0 && nodes != request.batch.columns().front().count)
      throw Error({.code = Code::kUnexpectedReply, .text = "the reply to a part of a step has other rows"});
    return;
  }
  if (asks<wire::OpenSession>(request)) {
    body_of<wire::SessionOpened>(received);
    epoch = received.reply.epoch;
  }
  if (asks<wire::Commit>(request)) body_of<wire::Committed>(received);
  if (asks<wire::Mark>(request)) body_of<wire::Marked>(received);
  if (asks<wire::CloseSession>(request)) body_of<wire::SessionClosed>(received);
  const auto* rollback = std::get_if<wire::Rollback>(&request.body);
  if (rollback != nullptr) body_of<wire::RolledBack>(received);
  const bool changes_nodes = asks<wire::RegisterNodes, wire::RetireNodes, wire::OfferNodes, wire::AcceptNodes>(request);
  if (changes_nodes) body_of<wire::NodesChanged>(received);
  if (!changes_nodes && (rollback == nullptr || rollback->to_mark.empty())) return;
  change_nodes(node_ids, request, received.reply.batch);
  if (closure) closure->forget();
}

void SessionState::adopt_position(Received& where) {
  auto& position = body_of<wire::SessionResumed>(where);
  last_sequence = position.last_sequence;
  state_version = position.state_version;
  offers = std::move(position.offers);
  if (closure) closure->forget();
  const auto nodes = std::as_const(where.reply.batch).u64(Field::kNodeId);
  node_ids.assign(nodes.begin(), nodes.end());
}

// Asks the server for the session's last sequence number, nodes and offers. Called after another request has run under
// the sequence number of the present one.
void SessionState::resynchronise() {
  Received where = ask(*connection, {.session_id = id, .body = wire::ResumeSession{.resume_token = resume_token}});
  adopt_position(where);
}

// A restarted server answers the last request of a session in any epoch. It refuses the next request with EPOCH; the
// client then claims the session, checks its last sequence number and sends the request again with the new epoch. The
// deadline begins anew: the restarted server is at work. A request that is SUPERSEDED after a claim of unknown outcome
// may have met a late copy of this client's own claim. A part that was sent ahead may have overtaken the part before it,
// which has been answered by now. An opening does not wait for the restart: it has no states yet.
Received SessionState::call(wire::Request& request) {
  auto started = connection->now();
  const auto* step = std::get_if<wire::Downscale>(&request.body);
  bool may_have_overtaken = step != nullptr && step->follows != 0;
  for (int restarts = 0;;) {
    const auto left = connection->left_since(started);
    try {
      return connection->call(request, left);
    } catch (const Error& fault) {
      const Code code = fault.status().code;
      if (code == Code::kSequenceGap && std::exchange(may_have_overtaken, false)) continue;
      const bool restarted = (code == Code::kEpoch || (code == Code::kSuperseded && claim_in_doubt.number != 0)) &&
                             request.epoch != 0 && restarts < kMostRestarts;
      const bool stopping = code == Code::kShuttingDown && connection->durable() && left > kStoppingPause &&
                            !asks<wire::OpenSession>(request);
      if (!restarted && !stopping) throw;
      if (restarted) {
        follow_restart(request, fault);
        started = connection->now();
        ++restarts;
      } else {
        connection->pause(kStoppingPause);
        if (const auto& interrupted = connection->options().interrupted; interrupted && interrupted()) throw;
      }
    }
  }
}

void SessionState::follow_restart(wire::Request& request, const Error& fault) {
  const bool superseded = fault.status().code == Code::kSuperseded;
  const auto claim = [&] {
    if (!superseded) return claim_session(*connection, id, resume_token, claim_in_doubt);
    try {
      return repeat_claim(*connection, id, resume_token, claim_in_doubt);
    } catch (const Error& refusal) {
      // Another restart: the server no longer grants the claim, but knows whether it was the last one.
      if (refusal.status().code != Code::kEpoch) throw;
      return claim_session(*connection, id, resume_token, claim_in_doubt, true);
    }
  };
  Received where;
  try {
    where = claim();
  } catch (const Error& refusal) {
    const Code code = refusal.status().code;
    // the first error explains the restart, or that another client has the session
    if (code == Code::kUnknownSession || (superseded && code == Code::kSuperseded)) throw Error(fault);
    throw;
  }
  const std::uint64_t stands_at = body_of<wire::SessionResumed>(where).last_sequence;
  if (stands_at + 1 != request.sequence) {
    wire::Status status = fault.status();
    status.text = fmt::format(
        "the server was restarted and came back with older states: the session stands at request "
        "{}, this client at {}",
        stands_at, last_sequence);
    status.remedy = "Go back to a mark of the host's last restart point, or begin the run anew with a new session.";
    status.last_sequence = stands_at;
    throw Error(std::move(status));
  }
  epoch = request.epoch = where.reply.epoch;
}

void SessionState::start_checks(bool from_the_start) {
  const ClientOptions& options = connection->options();
  if (options.check_closure == CheckClosure::kOff) return;
  closure.emplace(options.check_closure, options.log);
  if (from_the_start) inputs.emplace();
}

// The step has run, so a check that has no memory is left out.
void SessionState::check_answered(const Batch& request, const wire::Reply& reply) noexcept try {
  if (!closure) return;
  closure->answered(request, reply.batch, std::get<wire::Upscale>(reply.body), step_options);
  if (!inputs) return;
  for (const std::string& warning : inputs->add(request, step_options.dt_s, node_ids))
    write_line(connection->options().log, "warning: " + warning);
  if (inputs->doubts_units()) closure->doubt_units();
} catch (const std::exception&) {
}

void SessionState::end_checks() noexcept try {
  if (closure) closure->ended();
  if (!inputs) return;
  for (const std::string& warning : inputs->end()) write_line(connection->options().log, "warning: " + warning);
} catch (const std::exception&) {
}

wire::Request SessionState::step_request(const Batch& columns, const StepOptions& options) {
  if (closure) closure->compare(columns, node_ids, options);
  step_options = options;
  wire::Request request = next_request();
  request.body.emplace<wire::Downscale>(options).commit_previous = options.commit_previous && !previous_committed;
  request.batch = columns.view();
  return request;
}

const StepResult& SessionState::exchange_step(wire::Request request) {
  Received received = exchange(request);
  previous_committed = false;
  check_answered(request.batch, received.reply);
  state_version = body_of<wire::Upscale>(received).state_version;
  static_cast<Received&>(result) = std::move(received);
  return result;
}

const StepResult& SessionState::step(const Batch& columns, const StepOptions& options) {
  if (needs_parts(columns)) return step_in_parts(columns, options, std::nullopt);
  return exchange_step(step_request(columns, options));
}

void SessionState::start(const Batch& columns, const StepOptions& options) {
  started_in_parts.reset();
  wire::Request started = step_request(columns, options);
  if (needs_parts(columns)) {
    started_in_parts.emplace(columns.view());
    // A repetition of an interrupted step goes on with the part that was not answered, in finish().
    if (in_parts) return;
    started = part_request(part_rows(columns, 1), std::get<wire::Downscale>(started.body), 1,
                           parts_of(columns.columns().front().count));
  }
  post(started);
  posted.emplace(std::move(started));
}

const StepResult& SessionState::finish() {
  const std::optional<Batch> columns = std::exchange(started_in_parts, std::nullopt);
  std::optional<wire::Request> request = std::exchange(posted, std::nullopt);
  if (columns) return step_in_parts(*columns, step_options, std::move(request));
  if (!request)
    throw Error({.code = Code::kInvalidValue,
                 .text = "a step is finished that was not started",
                 .remedy = "Start a step first, and finish it once."});
  return exchange_step(std::move(*request));
}

// Sends a request, whose reply exchange() then waits for.
void SessionState::post(wire::Request& request) {
  give_id(request);
  try {
    connection->post(request);
  } catch (const Error&) {
    throw;  // the request was not sent
  } catch (...) {
    keep_in_doubt(request);
    throw;
  }
}

Received SessionState::read_profiles(Batch nodes) {
  wire::Request request{.request_id = connection->next_request_id(),
                        .session_id = id,
                        .sequence = last_sequence + 1,  // only for follow_restart(): the server ignores it
                        .epoch = epoch,
                        .body = wire::ReadProfiles{}};
  request.batch = std::move(nodes);
  return call(request);
}

}  // namespace shearbus
