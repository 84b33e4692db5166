#include "client/include/shearbus/client.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <random>
#include <utility>
#include <variant>

#include "client/src/connection.hpp"
#include "proto/wire/strategy_columns.hpp"

namespace shearbus {
namespace {

wire::SessionId random_session_id() {
  std::random_device source;
  wire::SessionId id;
  for (std::uint8_t& byte : id) byte = static_cast<std::uint8_t>(source());
  return id;
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

// The same columns, for the length of a call.
wire::Batch view_of(const wire::Batch& batch) {
  return wire::Batch::over(batch.columns(), batch.bytes());
}

}  // namespace

struct Session::Impl {
  std::shared_ptr<Connection> connection;
  wire::SessionId id{};
  std::uint64_t epoch = 0;
  std::vector<std::uint64_t> node_ids;
  wire::SessionOpened opened;
  std::vector<Field> wanted;
  std::uint64_t last_sequence = 0;
  std::optional<std::uint64_t> in_doubt;  // id of the request whose outcome is unknown
  bool closed = false;
  StepResult result;

  wire::Request next_request() const {
    wire::Request request;
    request.session_id = id;
    request.epoch = epoch;
    request.sequence = last_sequence + 1;
    request.request_id = in_doubt.value_or(0);
    return request;
  }

  // Sends the session's next request. Only an answered one counts. One without an answer keeps its id, so that the same
  // call again has the same bytes and the server knows it.
  Received exchange(wire::Request request) {
    if (request.request_id == 0) request.request_id = connection->next_request_id();
    try {
      Received received = connection->call(request, connection->options().reply_deadline);
      in_doubt.reset();
      last_sequence = request.sequence;
      return received;
    } catch (const Error& fault) {
      if (fault.status().code == Code::kUnknownOutcome)
        in_doubt = request.request_id;
      else if (fault.status().code != Code::kUnreachable)
        in_doubt.reset();
      if (fault.status().code == Code::kSequenceReused) last_sequence = fault.status().last_sequence;
      throw;
    }
  }

  const StepResult& step(const Batch& columns, const StepOptions& options, wire::Mode mode) {
    wire::Request request = next_request();
    request.body = wire::Downscale{.dt_s = options.dt_s,
                                   .time_s = options.time_s,
                                   .step = options.step,
                                   .attempt = options.attempt,
                                   .mode = mode,
                                   .commit_previous = options.commit_previous,
                                   .wanted = wanted};
    request.batch = view_of(columns);
    Received received = exchange(std::move(request));
    body_of<wire::Upscale>(received);
    result.payload_frame_ = std::move(received.payload_frame);
    result.reply_ = std::move(received.reply);
    result.round_trip_ = received.round_trip;
    return result;
  }

  Batch columns(std::span<const Field> optional_columns, bool with_node_ids, std::size_t count) const {
    std::vector<Field> fields;
    if (with_node_ids) fields.push_back(Field::kNodeId);
    for (const Field field : wire::columns_of(opened.effective_scene.strategy).required) fields.push_back(field);
    for (const Field field : optional_columns) fields.push_back(field);
    return Batch::of(fields, count);
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

Client::Client(ClientOptions options) : connection_(std::make_shared<Connection>(std::move(options))) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.body = wire::Hello{.client_name = connection_->options().name};
  try {
    Received received = connection_->call(request, connection_->options().connect_deadline);
    welcome_ = std::move(body_of<wire::Welcome>(received));
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
  const auto temperatures = options.initial_temperature_k;
  if (!temperatures.empty() && temperatures.size() != node_ids.size())
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} initial temperatures for {} nodes", temperatures.size(), node_ids.size()),
                 .remedy = "Give one per node, or none.",
                 .field = "initial_temperature_k"});
  auto impl = std::make_unique<Session::Impl>();
  impl->connection = connection_;
  impl->id = random_session_id();
  impl->node_ids.assign(node_ids.begin(), node_ids.end());

  std::vector<Field> fields = {Field::kNodeId};
  if (!temperatures.empty()) fields.push_back(Field::kInitialTemperature);
  wire::Request request;
  request.batch = Batch::of(fields, node_ids.size());
  std::copy(node_ids.begin(), node_ids.end(), request.batch.u64(Field::kNodeId).begin());
  std::copy(temperatures.begin(), temperatures.end(), request.batch.f64(Field::kInitialTemperature).begin());
  request.request_id = connection_->next_request_id();
  request.body = wire::OpenSession{.scene = scene, .session_id = impl->id};

  impl->closed = true;  // until it is open there is nothing to say goodbye to
  Received received;
  try {
    received = connection_->call(request, connection_->options().reply_deadline);
  } catch (const Error& fault) {
    if (fault.status().code != Code::kUnknownOutcome) throw;
    wire::Status status = fault.status();
    status.remedy = "Opening again is safe; it may leave an unused session on the server.";
    throw Error(std::move(status));
  }
  impl->epoch = received.reply.epoch;
  impl->opened = std::move(body_of<wire::SessionOpened>(received));
  impl->closed = false;
  return Session(std::move(impl));
}

wire::ServerStatus Client::server_status() {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.body = wire::ServerStatusQuery{};
  Received received = connection_->call(request, connection_->options().reply_deadline);
  return body_of<wire::ServerStatus>(received);
}

}  // namespace shearbus
