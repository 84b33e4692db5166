#include "client/include/shearbus/client.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <random>
#include <utility>
#include <variant>

#include "client/src/connection.hpp"
#include "proto/wire/codec.hpp"
#include "proto/wire/strategy_columns.hpp"

namespace shearbus {
namespace {

std::array<std::uint8_t, 16> random_bytes() {
  std::random_device source;
  std::array<std::uint8_t, 16> bytes;
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(source());
  return bytes;
}

// The body of a reply, which must be of the kind the request asks for.
template <typename Body>
Body& body_of(Received& received) {
  Body* body = std::get_if<Body>(&received.reply.body);
  if (body == nullptr)
    throw Error(
        {.code = Code::kUnexpectedReply,
         .text = fmt::format("the reply to request {} is of another kind than the request", received.reply.request_id),
         .remedy = "Client and server do not agree on the protocol; tell the maintainers."});
  return *body;
}

constexpr std::chrono::milliseconds kStoppingPause{100};  // between two questions to a server that is being restarted

// Makes the session this client's: what others have sent, or sent late, does not run any more. Tells where it stands.
Received claim_session(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token) {
  const auto ask = [&](std::uint64_t epoch, std::uint64_t claim) {
    wire::Request request;
    request.request_id = connection.next_request_id();
    request.session_id = id;
    request.epoch = epoch;
    request.body =
        wire::ResumeSession{.resume_token = token, .claim = claim, .claimant = claim == 0 ? 0 : connection.claimant()};
    return connection.call(request, connection.options().reply_deadline);
  };
  const auto started = connection.now();
  for (;;) {
    Received asked = ask(0, 0);
    try {
      return ask(asked.reply.epoch, body_of<wire::SessionResumed>(asked).claim + 1);
    } catch (const Error& fault) {
      // Between the two the server was restarted once more.
      const bool again = fault.status().code == Code::kEpoch && connection.left_since(started) > kStoppingPause;
      if (!again) throw;
    }
  }
}

bool same_bytes(const wire::Request& a, const wire::Request& b) {
  return wire::encode_header(a) == wire::encode_header(b) && std::ranges::equal(a.batch.bytes(), b.batch.bytes());
}

// Columns of an opening, or of a change of nodes.
wire::Batch named_nodes(std::span<const std::uint64_t> node_ids, std::span<const double> temperatures) {
  if (!temperatures.empty() && temperatures.size() != node_ids.size())
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} initial temperatures for {} nodes", temperatures.size(), node_ids.size()),
                 .remedy = "Give one per node, or none.",
                 .field = "initial_temperature_k"});
  std::vector<Field> fields = {Field::kNodeId};
  if (!temperatures.empty()) fields.push_back(Field::kInitialTemperature);
  wire::Batch batch = Batch::of(fields, node_ids.size());
  std::ranges::copy(node_ids, batch.u64(Field::kNodeId).begin());
  std::ranges::copy(temperatures, batch.f64(Field::kInitialTemperature).begin());
  return batch;
}

// The same columns, for the length of a call.
wire::Batch view_of(const wire::Batch& batch) {
  return wire::Batch::over(batch.columns(), batch.bytes());
}

}  // namespace

struct Session::Impl {
  std::shared_ptr<Connection> connection;
  wire::SessionId id{};
  wire::ResumeToken resume_token{};
  std::uint64_t epoch = 0;
  std::vector<std::uint64_t> node_ids;
  wire::SessionOpened opened;
  std::vector<Field> wanted;
  std::uint64_t last_sequence = 0;
  struct InDoubt {  // the request whose outcome is unknown: the same call again must have the same bytes
    std::uint64_t request_id = 0;
    std::uint64_t epoch = 0;
  };
  std::optional<InDoubt> in_doubt;
  std::vector<TransferId> offers;
  TransferId offered{};                 // of the last offer: that one's as long as it is in doubt
  std::optional<wire::Request> posted;  // a trial that was sent and not yet asked for
  bool closed = false;
  StepResult result;

  wire::Request next_request() const {
    wire::Request request;
    request.session_id = id;
    request.epoch = in_doubt ? in_doubt->epoch : epoch;
    request.sequence = last_sequence + 1;
    request.request_id = in_doubt ? in_doubt->request_id : 0;
    return request;
  }

  // Sends the session's next request. Only an answered one counts. One without an answer keeps its id, so that the same
  // call again has the same bytes and the server knows it.
  Received exchange(wire::Request request) {
    if (request.request_id == 0) request.request_id = connection->next_request_id();
    try {
      Received received = call(request);
      in_doubt.reset();
      last_sequence = request.sequence;
      return received;
    } catch (const Error& fault) {
      // A server that cannot run it now may still run a copy that is on its way.
      const bool not_now = static_cast<int>(fault.status().code) / 100 == 4;
      if (fault.status().code == Code::kUnknownOutcome || not_now)
        in_doubt = InDoubt{request.request_id, request.epoch};
      else if (fault.status().code != Code::kUnreachable && fault.status().code != Code::kAuth)
        in_doubt.reset();
      if (fault.status().code == Code::kSequenceReused) take_up();
      throw;
    }
  }

  void stand_where(Received& where) {
    auto& resumed = body_of<wire::SessionResumed>(where);
    last_sequence = resumed.last_sequence;
    offers = std::move(resumed.offers);
    const auto nodes = std::as_const(where.reply.batch).u64(Field::kNodeId);
    node_ids.assign(nodes.begin(), nodes.end());
  }

  // Another call has run than the one that was made now: where the session stands is asked.
  void take_up() {
    wire::Request request;
    request.request_id = connection->next_request_id();
    request.session_id = id;
    request.body = wire::ResumeSession{.resume_token = resume_token};
    Received where = connection->call(request, connection->options().reply_deadline);
    stand_where(where);
  }

  // A request that changes the set of nodes.
  template <typename Body>
  Received change_nodes(const Body& body, std::span<const std::uint64_t> nodes,
                        std::span<const double> temperatures = {}) {
    wire::Request request = next_request();
    request.body = body;
    if (!nodes.empty()) request.batch = named_nodes(nodes, temperatures);
    Received received = exchange(std::move(request));
    body_of<wire::NodesChanged>(received);
    return received;
  }

  void forget(std::span<const std::uint64_t> nodes) {
    std::vector<std::uint64_t> gone(nodes.begin(), nodes.end());
    std::ranges::sort(gone);
    std::erase_if(node_ids, [&](std::uint64_t node) { return std::ranges::binary_search(gone, node); });
  }

  // A server that was restarted answers the last request of the session whatever its epoch; it refuses the next one
  // with EPOCH until that is sent for the new epoch, which is done once it is sure where the session stands.
  Received call(wire::Request& request) {
    const auto started = connection->now();
    for (;;) {
      const auto left = connection->left_since(started);
      try {
        return connection->call(request, left);
      } catch (const Error& fault) {
        const bool restarted = fault.status().code == Code::kEpoch && request.epoch != 0;
        const bool stopping =
            fault.status().code == Code::kShuttingDown && connection->durable() && left > kStoppingPause;
        if (!restarted && !stopping) throw;
        if (restarted)
          follow_restart(request, fault);
        else
          connection->pause(kStoppingPause);
      }
    }
  }

  void follow_restart(wire::Request& request, const Error& fault) {
    Received where;
    try {
      where = claim_session(*connection, id, resume_token);
    } catch (const Error& refusal) {
      if (refusal.status().code == Code::kUnknownSession) throw fault;  // which says what that means
      throw;
    }
    const std::uint64_t stands_at = body_of<wire::SessionResumed>(where).last_sequence;
    if (stands_at + 1 != request.sequence) {
      wire::Status status = fault.status();
      status.text = fmt::format(
          "the server was restarted and came back with older states: the session stands at request "
          "{}, this client at {}",
          stands_at, last_sequence);
      status.remedy = "Open a new session and start again from the host's last restart point.";
      status.last_sequence = stands_at;
      throw Error(std::move(status));
    }
    epoch = request.epoch = where.reply.epoch;
  }

  wire::Request step_request(const Batch& columns, const StepOptions& options, wire::Mode mode) const {
    wire::Request request = next_request();
    request.body = wire::Downscale{.dt_s = options.dt_s,
                                   .time_s = options.time_s,
                                   .step = options.step,
                                   .attempt = options.attempt,
                                   .mode = mode,
                                   .commit_previous = options.commit_previous,
                                   .wanted = wanted,
                                   .policy = options.policy};
    request.batch = view_of(columns);
    return request;
  }

  const StepResult& take(wire::Request request) {
    Received received = exchange(std::move(request));
    body_of<wire::Upscale>(received);
    result.payload_frame_ = std::move(received.payload_frame);
    result.reply_ = std::move(received.reply);
    result.round_trip_ = received.round_trip;
    return result;
  }

  const StepResult& step(const Batch& columns, const StepOptions& options, wire::Mode mode) {
    return take(step_request(columns, options, mode));
  }

  Batch columns(std::span<const Field> optional_columns, bool with_node_ids, std::size_t count) const {
    std::vector<Field> fields;
    if (with_node_ids) fields.push_back(Field::kNodeId);
    for (const Field field : wire::columns_of(opened.effective_scene.strategy).required) fields.push_back(field);
    for (const Field field : optional_columns) fields.push_back(field);
    return Batch::of(fields, count, opened.effective_scene.tangential_components);
  }
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&& other) noexcept {
  std::swap(impl_, other.impl_);  // the other says goodbye for what was here
  return *this;
}

Session::~Session() {
  if (!impl_ || impl_->closed) return;
  wire::Request request = impl_->next_request();
  if (impl_->posted) ++request.sequence;  // it has run, or will have when the goodbye arrives
  if (request.request_id == 0) request.request_id = impl_->connection->next_request_id();
  request.body = wire::CloseSession{.reason = "the client has gone"};
  impl_->connection->say(request);
}

Batch Session::request(std::span<const Field> optional_columns) const {
  return impl_->columns(optional_columns, false, impl_->node_ids.size());
}

Batch Session::request_for(std::span<const std::uint64_t> node_ids, std::span<const Field> optional_columns) const {
  Batch batch = impl_->columns(optional_columns, true, node_ids.size());
  std::copy(node_ids.begin(), node_ids.end(), batch.u64(Field::kNodeId).begin());
  return batch;
}

const StepResult& Session::advance(const Batch& request, const StepOptions& step) {
  return impl_->step(request, step, wire::Mode::kAdvance);
}

const StepResult& Session::trial(const Batch& request, const StepOptions& step) {
  return impl_->step(request, step, wire::Mode::kTrial);
}

void Session::start_trial(const Batch& request, const StepOptions& step) {
  wire::Request started = impl_->step_request(request, step, wire::Mode::kTrial);
  if (started.request_id == 0) started.request_id = impl_->connection->next_request_id();
  impl_->connection->post(started);
  impl_->posted.emplace(std::move(started));
}

const StepResult& Session::finish_trial() {
  if (!impl_->posted)
    throw Error({.code = Code::kInvalidValue,
                 .text = "finish_trial() without start_trial()",
                 .remedy = "Start a trial first, and finish it once."});
  wire::Request request = std::move(*impl_->posted);
  impl_->posted.reset();
  return impl_->take(std::move(request));
}

std::uint64_t Session::commit() {
  wire::Request request = impl_->next_request();
  request.body = wire::Commit{};
  Received received = impl_->exchange(std::move(request));
  return body_of<wire::Committed>(received).state_version;
}

std::uint64_t Session::rollback() {
  wire::Request request = impl_->next_request();
  request.body = wire::Rollback{};
  Received received = impl_->exchange(std::move(request));
  return body_of<wire::RolledBack>(received).state_version;
}

std::uint64_t Session::rollback_to(const std::string& mark) {
  wire::Request request = impl_->next_request();
  request.body = wire::Rollback{.to_mark = mark};
  Received received = impl_->exchange(std::move(request));
  const std::uint64_t version = body_of<wire::RolledBack>(received).state_version;
  const auto nodes = std::as_const(received.reply.batch).u64(Field::kNodeId);
  impl_->node_ids.assign(nodes.begin(), nodes.end());
  return version;
}

wire::Marked Session::mark(const std::string& name) {
  wire::Request request = impl_->next_request();
  request.body = wire::Mark{.name = name};
  Received received = impl_->exchange(std::move(request));
  return std::move(body_of<wire::Marked>(received));
}

void Session::register_nodes(std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature_k) {
  impl_->change_nodes(wire::RegisterNodes{}, node_ids, initial_temperature_k);
  impl_->node_ids.insert(impl_->node_ids.end(), node_ids.begin(), node_ids.end());
}

void Session::retire_nodes(std::span<const std::uint64_t> node_ids) {
  impl_->change_nodes(wire::RetireNodes{}, node_ids);
  impl_->forget(node_ids);
}

TransferId Session::offer_nodes(std::span<const std::uint64_t> node_ids) {
  if (!impl_->in_doubt) impl_->offered = random_bytes();
  impl_->change_nodes(wire::OfferNodes{.transfer_id = impl_->offered}, node_ids);
  impl_->forget(node_ids);
  return impl_->offered;
}

std::vector<std::uint64_t> Session::accept_nodes(const TransferId& transfer) {
  const Received received = impl_->change_nodes(wire::AcceptNodes{.transfer_id = transfer}, {});
  const auto accepted = received.reply.batch.u64(Field::kNodeId);
  impl_->node_ids.insert(impl_->node_ids.end(), accepted.begin(), accepted.end());
  return {accepted.begin(), accepted.end()};
}

wire::SessionClosed Session::close() {
  wire::Request request = impl_->next_request();
  request.body = wire::CloseSession{};
  Received received = impl_->exchange(std::move(request));
  impl_->closed = true;
  return body_of<wire::SessionClosed>(received);
}

void Session::want(std::vector<Field> columns) {
  impl_->wanted = std::move(columns);
}
void Session::want_energy_ledger() {
  if (impl_->opened.effective_scene.layer.inertia) return;
  const auto columns = wire::columns_of(impl_->opened.effective_scene.strategy).reply;
  impl_->wanted.assign(columns.begin(), columns.end());
  impl_->wanted.insert(impl_->wanted.end(), wire::kLedgerColumns.begin(), wire::kLedgerColumns.end());
}
const Scene& Session::effective_scene() const {
  return impl_->opened.effective_scene;
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
void Session::leave() {
  impl_->closed = true;
}

Client::Client(ClientOptions options) : Client(std::make_shared<SocketConnection>(std::move(options))) {}

Client::Client(std::shared_ptr<Connection> connection) : connection_(std::move(connection)) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.body = wire::Hello{.client_name = connection_->options().name};
  try {
    Received received = connection_->call(request, connection_->options().connect_deadline);
    welcome_ = std::move(body_of<wire::Welcome>(received));
    connection_->set_durable(welcome_.durability != "none");
  } catch (const Error& fault) {
    if (fault.status().code != Code::kUnknownOutcome) throw;
    // A greeting changes nothing: that it was not answered means that nobody is there who could.
    wire::Status status = fault.status();
    status.code = Code::kUnreachable;
    status.text = fmt::format("{} accepts connections but did not answer the greeting within {} ms",
                              connection_->options().endpoint, connection_->options().connect_deadline.count());
    status.remedy = "Is it a shearbus server, and is it busy with a long step?";
    throw Error(std::move(status));
  }
}

Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;
Client::~Client() = default;

const wire::Welcome& Client::welcome() const {
  return welcome_;
}

Session Client::open(const Scene& scene, std::span<const std::uint64_t> node_ids, const OpenOptions& options) {
  wire::Request request;
  if (!node_ids.empty()) request.batch = named_nodes(node_ids, options.initial_temperature_k);
  auto& opening = request.body.emplace<wire::OpenSession>();
  opening.scene = scene;
  opening.domain = options.domain;
  const std::optional<wire::Request> doubted = std::exchange(connection_->opening_in_doubt, std::nullopt);
  if (doubted) {
    const auto& before = std::get<wire::OpenSession>(doubted->body);
    request.request_id = doubted->request_id;
    opening.session_id = before.session_id;
    opening.resume_token = before.resume_token;
  }
  if (!doubted || !same_bytes(request, *doubted)) {
    request.request_id = connection_->next_request_id();
    opening.session_id = random_bytes();
    opening.resume_token = random_bytes();
  }

  auto impl = std::make_unique<Session::Impl>();
  impl->connection = connection_;
  impl->id = opening.session_id;
  impl->resume_token = opening.resume_token;
  impl->node_ids.assign(node_ids.begin(), node_ids.end());

  impl->closed = true;  // until it is open there is nothing to say goodbye to
  Received received;
  try {
    received = connection_->call(request, connection_->options().reply_deadline);
  } catch (const Error& fault) {
    connection_->opening_in_doubt = std::move(request);
    if (fault.status().code != Code::kUnknownOutcome) throw;
    wire::Status status = fault.status();
    status.remedy = "Open again with the same arguments: it is the same session, opened once.";
    throw Error(std::move(status));
  }
  impl->epoch = received.reply.epoch;
  impl->opened = std::move(body_of<wire::SessionOpened>(received));
  impl->closed = false;
  return Session(std::move(impl));
}

Session Client::resume(const Session::Ticket& ticket) {
  Received received = claim_session(*connection_, ticket.session_id, ticket.resume_token);
  auto impl = std::make_unique<Session::Impl>();
  impl->connection = connection_;
  impl->id = ticket.session_id;
  impl->resume_token = ticket.resume_token;
  impl->epoch = received.reply.epoch;
  impl->opened = std::move(body_of<wire::SessionResumed>(received).session);
  impl->stand_where(received);
  return Session(std::move(impl));
}

template <typename Answer, typename Question>
Answer Client::ask(Question question) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.body = std::move(question);
  Received received = connection_->call(request, connection_->options().reply_deadline);
  return std::move(body_of<Answer>(received));
}

wire::ServerStatus Client::server_status() {
  return ask<wire::ServerStatus>(wire::ServerStatusQuery{});
}
wire::Checkpointed Client::checkpoint() {
  return ask<wire::Checkpointed>(wire::Checkpoint{});
}
wire::Draining Client::drain(bool exit) {
  return ask<wire::Draining>(wire::Drain{.exit = exit});
}

std::vector<wire::SessionInfo> Client::sessions() {
  std::vector<wire::SessionInfo> all;
  for (bool more = true; more;) {
    auto page = ask<wire::Inspected>(wire::Inspect{.after = all.empty() ? wire::SessionId{} : all.back().session_id});
    more = page.more && !page.sessions.empty();
    all.insert(all.end(), page.sessions.begin(), page.sessions.end());
  }
  return all;
}

TopNodes Client::top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.session_id = session;
  request.body = wire::Inspect{.top = by, .count = count};
  Received received = connection_->call(request, connection_->options().reply_deadline);
  auto& inspected = body_of<wire::Inspected>(received);
  const Batch& batch = received.reply.batch;
  TopNodes top{.session = inspected.sessions.empty() ? wire::SessionInfo{} : std::move(inspected.sessions.front()),
               .matching = inspected.matching};
  const auto copy = [](const auto& column, auto& to) { to.assign(column.begin(), column.end()); };
  copy(batch.u64(Field::kNodeId), top.node_ids);
  copy(batch.f64(Field::kInterfaceTemperature), top.interface_temperature_k);
  copy(batch.f64(Field::kShearStress), top.shear_stress_pa);
  copy(batch.f64(Field::kSlidingVelocity), top.sliding_velocity_m_per_s);
  copy(batch.u8(Field::kRegime), top.regime);
  return top;
}

wire::SessionClosed Client::close(const wire::SessionInfo& session) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.session_id = session.session_id;
  request.sequence = session.last_sequence + 1;
  request.body = wire::CloseSession{.reason = "closed by an operator"};
  Received received = connection_->call(request, connection_->options().reply_deadline);
  return body_of<wire::SessionClosed>(received);
}

}  // namespace shearbus
