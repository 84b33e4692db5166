// A session sends its requests in the order of their sequence numbers and waits for the reply to each.
#include "client/src/session.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <random>

#include "proto/wire/codec.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/xxh3.hpp"

namespace shearbus {
namespace {

constexpr std::chrono::milliseconds kStoppingPause{100};  // pause between two attempts while the server restarts
constexpr int kMostRestarts = 20;                         // restarts of the server that one call follows

// The columns of numbers in memory of their own, which outlives the received frame.
Batch copy_of(const Batch& batch) {
  Batch copy = columns_of(batch, batch.columns().front().count);
  for (const wire::Column& column : batch.columns()) {
    if (column.element == wire::Element::kUint64)
      std::ranges::copy(batch.u64(column.field), copy.u64(column.field).begin());
    else
      std::ranges::copy(batch.f64(column.field, column.component), copy.f64(column.field, column.component).begin());
  }
  return copy;
}

}  // namespace

Batch columns_of(const Batch& batch, std::size_t rows) {
  std::vector<Field> fields;
  std::uint32_t components = 1;
  for (const wire::Column& column : batch.columns()) {
    if (column.component == 0) fields.push_back(column.field);
    components = std::max(components, column.component + 1);
  }
  return Batch::of(fields, rows, components);
}

std::array<std::uint8_t, 16> random_bytes() {
  std::random_device source;
  std::array<std::uint8_t, 16> bytes;
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(source());
  return bytes;
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

wire::Batch named_nodes(std::span<const std::uint64_t> node_ids) {
  return new_nodes(node_ids, {}, {});
}

namespace {

void check_length(std::size_t values, std::size_t nodes, const std::string& what, const std::string& field) {
  if (values != nodes)
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} {} for {} nodes", values, what, nodes),
                 .remedy = "Give one per node, or none.",
                 .field = field});
}

// Refuses parameters that are not those of the session, each once. Returns their order in the session's list.
std::vector<const NodeOptions::Parameter*> in_order(const NodeOptions& options, std::span<const std::string> keys) {
  std::vector<const NodeOptions::Parameter*> ordered;
  for (const std::string& key : keys) {
    const auto found = std::ranges::find(options.parameters, key, &NodeOptions::Parameter::key);
    if (found != options.parameters.end()) ordered.push_back(&*found);
  }
  if (ordered.size() != options.parameters.size() || (!ordered.empty() && ordered.size() != keys.size()))
    throw Error(
        {.code = Code::kShape,
         .text = fmt::format("{} parameters for nodes of a session whose parameters are: {}", options.parameters.size(),
                             keys.empty() ? "none" : fmt::format("{}", fmt::join(keys, ", "))),
         .remedy = "Give values for each of them, or for none; the opening of the session chooses the keys.",
         .field = "parameters"});
  return ordered;
}

}  // namespace

wire::Batch new_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options,
                      std::span<const std::string> keys) {
  const auto parameters = in_order(options, keys);
  std::vector<Field> fields = {Field::kNodeId};
  if (!options.initial_temperature_k.empty()) {
    check_length(options.initial_temperature_k.size(), node_ids.size(), "initial temperatures",
                 "initial_temperature_k");
    fields.push_back(Field::kInitialTemperature);
  }
  if (!options.pair.empty() || !options.pairs.empty()) {
    check_length(options.pair.size(), node_ids.size(), "pairs", "pair");
    fields.push_back(Field::kPair);
  }
  for (const NodeOptions::Parameter* parameter : parameters)
    check_length(parameter->values.size(), node_ids.size(), "values of " + parameter->key, parameter->key);
  if (!parameters.empty()) fields.push_back(Field::kParameter);
  if (node_ids.empty()) return {};
  const auto components = static_cast<std::uint32_t>(std::max<std::size_t>(1, parameters.size()));
  wire::Batch batch = Batch::of(fields, node_ids.size(), components);
  std::ranges::copy(node_ids, batch.u64(Field::kNodeId).begin());
  std::ranges::copy(options.initial_temperature_k, batch.f64(Field::kInitialTemperature).begin());
  std::ranges::copy(options.pair, batch.u64(Field::kPair).begin());
  for (std::uint32_t i = 0; i < parameters.size(); ++i)
    std::ranges::copy(parameters[i]->values, batch.f64(Field::kParameter, i).begin());
  return batch;
}

wire::Request Session::Impl::next_request() const {
  wire::Request request;
  request.session_id = id;
  request.epoch = in_doubt ? in_doubt->epoch : epoch;
  request.sequence = last_sequence + 1;
  request.request_id = in_doubt ? in_doubt->request_id : 0;
  return request;
}

// A request that repeats one of unknown outcome has its id. With another payload it is another request, which the server
// could not tell by a header without a sum.
void Session::Impl::give_id(wire::Request& request) {
  const bool other =
      in_doubt && request.request_id == in_doubt->request_id && wire::xxh3(request.batch.bytes()) != in_doubt->payload;
  if (request.request_id == 0 || other) request.request_id = connection->next_request_id();
}

void Session::Impl::keep_in_doubt(const wire::Request& request) noexcept {
  in_doubt = InDoubt{request.request_id, request.epoch, wire::xxh3(request.batch.bytes())};
}

template <typename Accept>
Received Session::Impl::exchange(wire::Request&& request, const Accept& accept) {
  give_id(request);
  try {
    Received received = call(request);
    accept(received);
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

Received Session::Impl::send(wire::Request& request, const std::function<void(Received&)>& accept) {
  return exchange(std::move(request), accept);  // leaves the request as it was sent
}

void Session::Impl::adopt_position(Received& where) {
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
void Session::Impl::resynchronise() {
  Received where = ask(*connection, {.session_id = id, .body = wire::ResumeSession{.resume_token = resume_token}});
  adopt_position(where);
}

void Session::Impl::remove_nodes(std::span<const std::uint64_t> nodes) {
  std::vector<std::uint64_t> gone(nodes.begin(), nodes.end());
  std::ranges::sort(gone);
  std::erase_if(node_ids, [&](std::uint64_t node) { return std::ranges::binary_search(gone, node); });
  if (closure) closure->forget();
}

// A restarted server answers the last request of a session in any epoch. It refuses the next request with EPOCH; the
// client then claims the session, checks its last sequence number and sends the request again with the new epoch. The
// deadline begins anew: the restarted server is at work. A request that is SUPERSEDED after a claim of unknown outcome
// may have met a late copy of this client's own claim. A part that was sent ahead may have overtaken the part before it,
// which has been answered by now.
Received Session::Impl::call(wire::Request& request) {
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
      const bool stopping =
          fault.status().code == Code::kShuttingDown && connection->durable() && left > kStoppingPause;
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

void Session::Impl::follow_restart(wire::Request& request, const Error& fault) {
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

void Session::Impl::start_checks(bool from_the_start) {
  const ClientOptions& options = connection->options();
  if (options.check_closure == CheckClosure::kOff) return;
  closure.emplace(options.check_closure, options.log);
  if (from_the_start) inputs.emplace();
}

// The step has run, so a check that has no memory is left out.
void Session::Impl::check_answered(const Batch& request, const wire::Reply& reply, wire::Mode mode) noexcept try {
  if (!closure) return;
  closure->answered(request, reply.batch, std::get<wire::Upscale>(reply.body), step_options, mode);
  if (!inputs) return;
  for (const std::string& warning : inputs->add(request, step_options.dt_s))
    write_line(connection->options().log, "warning: " + warning);
  if (inputs->doubts_units()) closure->doubt_units();
} catch (const std::exception&) {
}

void Session::Impl::end_checks() noexcept try {
  if (closure) closure->ended();
  if (!inputs) return;
  for (const std::string& warning : inputs->end()) write_line(connection->options().log, "warning: " + warning);
} catch (const std::exception&) {
}

wire::Request Session::Impl::step_request(const Batch& columns, const StepOptions& options, wire::Mode mode) {
  if (closure) closure->compare(columns, node_ids, options);
  step_options = options;
  wire::Request request = next_request();
  request.body = wire::Downscale{.dt_s = options.dt_s,
                                 .time_s = options.time_s,
                                 .step = options.step,
                                 .attempt = options.attempt,
                                 .mode = mode,
                                 .commit_previous = options.commit_previous && !previous_committed,
                                 .wanted = wanted,
                                 .policy = options.policy,
                                 .absent_nodes = options.absent_nodes};
  request.batch = columns.view();
  return request;
}

const StepResult& Session::Impl::exchange_step(wire::Request request) {
  // exchange() leaves the request as it was sent. NOLINTBEGIN(bugprone-use-after-move)
  Received received = exchange(std::move(request), [](Received& reply) { body_of<wire::Upscale>(reply); });
  previous_committed = false;
  check_answered(request.batch, received.reply, std::get<wire::Downscale>(request.body).mode);
  // NOLINTEND(bugprone-use-after-move)
  state_version = body_of<wire::Upscale>(received).state_version;
  result.payload_frame_ = std::move(received.payload_frame);
  result.reply_ = std::move(received.reply);
  result.round_trip_ = received.round_trip;
  return result;
}

const StepResult& Session::Impl::step(const Batch& columns, const StepOptions& options, wire::Mode mode) {
  if (needs_parts(columns)) return step_in_parts(columns, options, mode, std::nullopt);
  return exchange_step(step_request(columns, options, mode));
}

// Columns of unequal length are sent undivided: the server refuses them with a reason.
bool Session::Impl::needs_parts(const Batch& columns) const {
  const auto& all = columns.columns();
  return !all.empty() && all.front().count > connection->max_rows() &&
         std::ranges::all_of(all, [&](const wire::Column& column) { return column.count == all.front().count; });
}

Batch Session::Impl::part_rows(const Batch& columns, std::uint32_t part) const {
  const std::size_t rows = columns.columns().front().count;
  const std::size_t first = (part - 1) * connection->max_rows();
  const std::size_t count = std::min(connection->max_rows(), rows - first);
  std::vector<Field> fields = {Field::kNodeId};
  for (const wire::Column& column : columns.columns())
    if (column.field != Field::kNodeId && column.component == 0) fields.push_back(column.field);
  Batch batch = Batch::of(fields, count, opened.tangential_components);
  const std::span<const std::uint64_t> ids = columns.has(Field::kNodeId) ? columns.u64(Field::kNodeId) : node_ids;
  std::ranges::copy(ids.subspan(first, count), batch.u64(Field::kNodeId).begin());
  for (const wire::Column& column : columns.columns())
    if (column.field != Field::kNodeId)
      std::ranges::copy(columns.f64(column.field, column.component).subspan(first, count),
                        batch.f64(column.field, column.component).begin());
  return batch;
}

std::uint32_t Session::Impl::parts_of(std::size_t rows) const {
  return static_cast<std::uint32_t>((rows + connection->max_rows() - 1) / connection->max_rows());
}

wire::Request Session::Impl::part_request(Batch rows, const wire::Downscale& step, std::uint32_t part,
                                          std::uint32_t parts) const {
  wire::Request request = next_request();
  wire::Downscale& body = request.body.emplace<wire::Downscale>(step);
  body.part = part;
  body.parts = parts;
  body.commit_previous = step.commit_previous && part == 1 && !previous_committed;
  request.batch = std::move(rows);
  return request;
}

// The part behind `before`, to be sent before that one is answered.
wire::Request Session::Impl::part_behind(const wire::Request& before, Batch rows) {
  const auto& step = std::get<wire::Downscale>(before.body);
  wire::Request request = part_request(std::move(rows), step, step.part + 1, step.parts);
  StepInParts::Sent& sent = in_parts->behind;
  // A part of another epoch cannot have run, because the part before it has not.
  if (sent.request_id == 0 || sent.epoch != before.epoch) {
    const std::string header = wire::encode_header(before, {}, connection->payload_sum());
    const std::array<std::span<const std::byte>, 1> bytes = {std::as_bytes(std::span(header))};
    sent = {.request_id = connection->next_request_id(), .epoch = before.epoch, .follows = wire::hash_of(bytes)};
  }
  request.sequence = before.sequence + 1;
  request.request_id = sent.request_id;
  request.epoch = sent.epoch;
  std::get<wire::Downscale>(request.body).follows = sent.follows;
  return request;
}

// Copies the answers of a part to their rows of the whole reply.
void Session::Impl::copy_part(const Received& part, std::size_t first_row) noexcept {
  Batch& whole = in_parts->reply.batch;
  const Batch& rows = part.reply.batch;
  for (const wire::Column& column : whole.columns()) {
    const auto at = static_cast<std::ptrdiff_t>(first_row);
    if (column.element == wire::Element::kUint8)
      std::ranges::copy(rows.u8(column.field), whole.u8(column.field).begin() + at);
    else
      std::ranges::copy(rows.f64(column.field, column.component),
                        whole.f64(column.field, column.component).begin() + at);
  }
}

// Adds what the answer of a part says of all its rows.
void Session::Impl::add_part(const Received& part) {
  const auto& answer = std::get<wire::Upscale>(part.reply.body);
  auto& sum = std::get<wire::Upscale>(in_parts->reply.body);
  if (sum.nodes == 0 || answer.largest_closure_m_per_s > sum.largest_closure_m_per_s) {
    sum.largest_closure_m_per_s = answer.largest_closure_m_per_s;
    sum.closure_node = answer.closure_node;
    sum.layer_time_s = answer.layer_time_s;
  }
  sum.nodes += answer.nodes;
  sum.state_version = answer.state_version;
  sum.solver_ns += answer.solver_ns;
  sum.service_ns += answer.service_ns;
  sum.flagged_nodes += answer.flagged_nodes;
  sum.warnings.insert(sum.warnings.end(), answer.warnings.begin(), answer.warnings.end());
  in_parts->reply.replayed |= part.reply.replayed;
  in_parts->round_trip += part.round_trip;
  ++in_parts->answered;
}

// A step of more rows than a message holds. While the server computes a part, the rows of the next part are gathered and
// sent, if the server takes parts ahead, and the answers of the part before it are copied. If a part has no answer in
// time, a repetition of the call goes on with that part, and sends what was sent before with the same bytes. If a part
// is refused, the parts before it are dropped; the part behind it was refused, too, because it follows that part.
// `first`: part 1, if it was posted.
const StepResult& Session::Impl::step_in_parts(const Batch& columns, const StepOptions& options, wire::Mode mode,
                                               std::optional<wire::Request> first) {
  const auto step = std::get<wire::Downscale>(first ? first->body : step_request(columns, options, mode).body);
  const std::size_t rows = columns.columns().front().count;
  wire::Downscale whole = step;
  whole.part = whole.parts = 0;
  whole.commit_previous = options.commit_previous;
  const std::string header = wire::encode_header(wire::Request{.body = whole});
  const std::array<std::span<const std::byte>, 2> bytes = {std::as_bytes(std::span(header)), columns.bytes()};
  const std::uint64_t hash = wire::hash_of(bytes);
  if (!in_parts || in_parts->hash != hash) {
    in_parts = StepInParts{};
    in_parts->hash = hash;
    in_parts->reply.body = wire::Upscale{};
  }
  const std::uint32_t parts = parts_of(rows);
  std::optional<Received> to_copy;  // the last part that was answered
  const auto copy = [&]() noexcept {
    if (to_copy) copy_part(*to_copy, (in_parts->answered - 1) * connection->max_rows());
    to_copy.reset();
  };
  Batch next;                           // rows of the next part; without columns if they are not gathered yet
  std::optional<wire::Request> behind;  // the next part, if it was sent ahead
  auto answered_at = Connection::Clock::time_point();  // of the last part
  try {
    while (in_parts->answered < parts) {
      const std::uint32_t part = in_parts->answered + 1;
      wire::Request request;
      if (first) {
        request = *std::exchange(first, std::nullopt);
      } else if (behind) {
        request = *std::exchange(behind, std::nullopt);
      } else {
        request = part_request(next.columns().empty() ? part_rows(columns, part) : std::exchange(next, {}), whole, part,
                               parts);
        if (const auto& sent = in_parts->next; sent.request_id != 0) {
          if (!in_doubt) {
            request.request_id = sent.request_id;
            request.epoch = sent.epoch;
          }
          std::get<wire::Downscale>(request.body).follows = sent.follows;
        }
        post(request);
      }
      in_parts->next = {.request_id = request.request_id,
                        .epoch = request.epoch,
                        .follows = std::get<wire::Downscale>(request.body).follows};
      try {
        next = part < parts ? part_rows(columns, part + 1) : Batch();
        if (part < parts && connection->parts_ahead()) {
          behind = part_behind(request, std::exchange(next, {}));
          connection->post_behind(*behind);
        }
        Batch& answers = in_parts->reply.batch;
        if (answers.columns().empty())
          answers = Batch::of(wanted.empty() ? opened.reply_columns : wanted, rows, opened.tangential_components);
        copy();
      } catch (const std::bad_alloc&) {
        keep_in_doubt(request);
        throw;
      }
      const std::size_t count = request.batch.columns().front().count;
      Received received = exchange(std::move(request), [&](Received& reply) {
        if (body_of<wire::Upscale>(reply).nodes != count)
          throw Error({.code = Code::kUnexpectedReply, .text = "the reply to a part of a step has other rows"});
      });
      // exchange() leaves the request as it was sent. NOLINTNEXTLINE(bugprone-use-after-move)
      if (behind && request.epoch != behind->epoch) {  // after a restart, which the part behind did not survive
        behind.reset();
        in_parts->behind = {};
      }
      const auto now = connection->now();
      received.round_trip = std::min<std::chrono::nanoseconds>(received.round_trip, now - answered_at);
      answered_at = now;
      add_part(received);
      in_parts->next = std::exchange(in_parts->behind, {});
      to_copy = std::move(received);
    }
    copy();
  } catch (const Error& fault) {
    copy();
    const Code code = fault.status().code;
    const bool goes_on = in_doubt || code == Code::kUnreachable || code == Code::kAuth;
    if (goes_on) throw;  // the same call goes on
    const bool begun = in_parts->answered != 0;
    in_parts.reset();
    if (!begun) throw;
    previous_committed = options.commit_previous;
    try {
      exchange<wire::RolledBack>(wire::Rollback{});
    } catch (const Error&) {
      // The next step drops the parts, too.
    }
    throw;
  }
  previous_committed = false;
  check_answered(columns, in_parts->reply, mode);
  state_version = std::get<wire::Upscale>(in_parts->reply.body).state_version;
  result.payload_frame_.reset();
  result.reply_ = std::move(in_parts->reply);
  result.round_trip_ = in_parts->round_trip;
  in_parts.reset();
  return result;
}

Batch Session::Impl::columns(std::span<const Field> optional_columns, Form form, bool with_node_ids,
                             std::size_t count) const {
  std::vector<Field> fields;
  if (with_node_ids) fields.push_back(Field::kNodeId);
  for (const Field field : wire::columns_in(form, opened.required_columns)) fields.push_back(field);
  for (const Field field : optional_columns) fields.push_back(field);
  return Batch::of(fields, count, opened.tangential_components);
}

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&& other) noexcept {
  std::swap(impl_, other.impl_);  // the destructor of `other` closes the session that was here
  return *this;
}

Session::~Session() try {
  if (!impl_ || impl_->closed) return;
  wire::Request request = impl_->next_request();
  if (impl_->posted) ++request.sequence;  // the posted step runs before the closing request
  if (request.request_id == 0) request.request_id = impl_->connection->next_request_id();
  request.body = wire::CloseSession{.reason = "the client has gone"};
  impl_->connection->say(request);
} catch (const std::exception&) {
  // If there is no memory for the closing request, the session stays open on the server.
}

Batch Session::request(std::span<const Field> optional_columns, Form form) const {
  return impl_->columns(optional_columns, form, false, impl_->node_ids.size());
}

Batch Session::request_for(std::span<const std::uint64_t> node_ids, std::span<const Field> optional_columns,
                           Form form) const {
  Batch batch = impl_->columns(optional_columns, form, true, node_ids.size());
  std::copy(node_ids.begin(), node_ids.end(), batch.u64(Field::kNodeId).begin());
  return batch;
}

const StepResult& Session::advance(const Batch& request, const StepOptions& step) {
  return impl_->step(request, step, wire::Mode::kAdvance);
}

const StepResult& Session::trial(const Batch& request, const StepOptions& step) {
  return impl_->step(request, step, wire::Mode::kTrial);
}

void Session::Impl::start(const Batch& columns, const StepOptions& options, wire::Mode mode) {
  started_in_parts.reset();
  wire::Request started = step_request(columns, options, mode);
  if (needs_parts(columns)) {
    started_in_parts.emplace(Started{columns.view(), mode});
    // A repetition of an interrupted step goes on with the part that was not answered, in finish_trial().
    if (in_parts) return;
    started = part_request(part_rows(columns, 1), std::get<wire::Downscale>(started.body), 1,
                           parts_of(columns.columns().front().count));
  }
  post(started);
  posted.emplace(std::move(started));
}

// Sends a request, whose reply exchange() then waits for.
void Session::Impl::post(wire::Request& request) {
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

void Session::start_trial(const Batch& request, const StepOptions& step) {
  impl_->start(request, step, wire::Mode::kTrial);
}

void Session::start_advance(const Batch& request, const StepOptions& step) {
  impl_->start(request, step, wire::Mode::kAdvance);
}

const StepResult& Session::finish_trial() {
  if (impl_->started_in_parts) {
    const Session::Impl::Started started = std::move(*impl_->started_in_parts);
    impl_->started_in_parts.reset();
    return impl_->step_in_parts(started.columns, impl_->step_options, started.mode,
                                std::exchange(impl_->posted, std::nullopt));
  }
  if (!impl_->posted)
    throw Error({.code = Code::kInvalidValue,
                 .text = "a step is finished that was not started",
                 .remedy = "Start a step first, and finish it once."});
  wire::Request request = std::move(*impl_->posted);
  impl_->posted.reset();
  return impl_->exchange_step(std::move(request));
}

std::uint64_t Session::commit() {
  impl_->state_version = impl_->exchange<wire::Committed>(wire::Commit{}).state_version;
  if (impl_->closure) impl_->closure->committed();
  return impl_->state_version;
}

std::uint64_t Session::rollback() {
  impl_->state_version = impl_->exchange<wire::RolledBack>(wire::Rollback{}).state_version;
  if (impl_->closure) impl_->closure->rolled_back();
  return impl_->state_version;
}

std::uint64_t Session::rollback_to(const std::string& mark) {
  const auto adopt_nodes = [&](Received& received) {
    const auto nodes = std::as_const(received.reply.batch).u64(Field::kNodeId);
    impl_->node_ids.assign(nodes.begin(), nodes.end());
    if (impl_->closure) impl_->closure->forget();
  };
  impl_->state_version =
      impl_->exchange<wire::RolledBack>(wire::Rollback{.to_mark = mark}, {}, adopt_nodes).state_version;
  return impl_->state_version;
}

wire::Marked Session::mark(const std::string& name) {
  return impl_->exchange<wire::Marked>(wire::Mark{.name = name});
}

void Session::register_nodes(std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature_k) {
  register_nodes(
      node_ids, NodeOptions{.initial_temperature_k = initial_temperature_k, .pairs = {}, .pair = {}, .parameters = {}});
}

void Session::register_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options) {
  const auto adopt_nodes = [&](Received&) {
    impl_->node_ids.insert(impl_->node_ids.end(), node_ids.begin(), node_ids.end());
    if (impl_->closure) impl_->closure->forget();
  };
  impl_->exchange<wire::NodesChanged>(wire::RegisterNodes{.pairs = options.pairs},
                                      new_nodes(node_ids, options, impl_->opened.parameters), adopt_nodes);
}

void Session::retire_nodes(std::span<const std::uint64_t> node_ids) {
  impl_->exchange<wire::NodesChanged>(wire::RetireNodes{}, named_nodes(node_ids),
                                      [&](Received&) { impl_->remove_nodes(node_ids); });
}

TransferId Session::offer_nodes(std::span<const std::uint64_t> node_ids) {
  if (!impl_->in_doubt) impl_->offered = random_bytes();
  impl_->exchange<wire::NodesChanged>(wire::OfferNodes{.transfer_id = impl_->offered}, named_nodes(node_ids),
                                      [&](Received&) { impl_->remove_nodes(node_ids); });
  return impl_->offered;
}

std::vector<std::uint64_t> Session::accept_nodes(const TransferId& transfer) {
  std::vector<std::uint64_t> nodes;
  impl_->exchange<wire::NodesChanged>(wire::AcceptNodes{.transfer_id = transfer}, {}, [&](Received& received) {
    const auto accepted = std::as_const(received.reply.batch).u64(Field::kNodeId);
    nodes.assign(accepted.begin(), accepted.end());
    impl_->node_ids.insert(impl_->node_ids.end(), nodes.begin(), nodes.end());
    if (impl_->closure) impl_->closure->forget();
  });
  return nodes;
}

Received Session::Impl::read_profiles(Batch nodes) {
  wire::Request request{.request_id = connection->next_request_id(),
                        .session_id = id,
                        .sequence = last_sequence + 1,  // only for follow_restart(): the server ignores it
                        .epoch = epoch,
                        .body = wire::ReadProfiles{}};
  request.batch = std::move(nodes);
  return call(request);
}

Profiles Session::profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa) {
  if (!pressure_pa.empty() && pressure_pa.size() != node_ids.size())
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} pressures for {} nodes", pressure_pa.size(), node_ids.size()),
                 .remedy = "Give one per node, or none.",
                 .field = wire::name(Field::kPressure)});
  std::vector<Field> fields = {Field::kNodeId};
  if (!pressure_pa.empty()) fields.push_back(Field::kPressure);
  Batch nodes = Batch::of(fields, node_ids.size());
  std::ranges::copy(node_ids, nodes.u64(Field::kNodeId).begin());
  std::ranges::copy(pressure_pa, nodes.f64(Field::kPressure).begin());
  Received received = impl_->read_profiles(std::move(nodes));
  const auto& answer = body_of<wire::Profiles>(received);
  const Batch& rows = received.reply.batch;
  if (answer.nodes != node_ids.size() || rows.columns().empty() ||
      std::ranges::any_of(rows.columns(),
                          [&](const wire::Column& column) { return column.count != answer.nodes * answer.vertices; }))
    throw Error({.code = Code::kUnexpectedReply, .text = "the reply to read_profiles has other rows"});
  impl_->state_version = answer.state_version;
  return {.nodes = node_ids.size(),
          .vertices = answer.vertices,
          .state_version = answer.state_version,
          .rows = copy_of(rows)};
}

wire::SessionClosed Session::close() {
  const auto totals = impl_->exchange<wire::SessionClosed>(wire::CloseSession{});
  impl_->closed = true;
  impl_->end_checks();
  return totals;
}

void Session::want(std::vector<Field> columns) {
  impl_->wanted = std::move(columns);
}
void Session::want_energy_ledger() {
  const std::vector<Field>& offered = impl_->opened.columns_on_request;
  if (std::ranges::find(offered, wire::kLedgerColumns.front()) == offered.end()) return;
  impl_->wanted = impl_->opened.reply_columns;
  impl_->wanted.insert(impl_->wanted.end(), wire::kLedgerColumns.begin(), wire::kLedgerColumns.end());
}
const std::string& Session::effective_scene() const {
  return impl_->opened.effective_scene;
}
const wire::SessionOpened& Session::opened() const {
  return impl_->opened;
}
const std::vector<std::string>& Session::warnings() const {
  return impl_->opened.warnings;
}
std::uint64_t Session::bytes_per_node() const {
  return impl_->opened.bytes_per_node;
}
const std::vector<std::uint64_t>& Session::node_ids() const {
  return impl_->node_ids;
}
Session::Ticket Session::ticket() const {
  return {.session_id = impl_->id, .resume_token = impl_->resume_token};
}
const std::vector<TransferId>& Session::offers() const {
  return impl_->offers;
}
std::uint64_t Session::last_sequence() const {
  return impl_->last_sequence;
}
std::uint64_t Session::state_version() const {
  return impl_->state_version;
}
const ResumedNodes& Session::resumed_nodes() const {
  return impl_->resumed;
}
void Session::forget_answers() {
  if (impl_->closure) impl_->closure->forget();
}

void Session::leave() {
  impl_->closed = true;
}

}  // namespace shearbus
