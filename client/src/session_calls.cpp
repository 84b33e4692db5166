// The calls of a session.
#include <algorithm>
#include <utility>

#include "client/src/session.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus {

Batch columns_of(const Batch& batch, std::size_t rows) {
  std::vector<Field> fields;
  std::uint32_t components = 1;
  for (const wire::Column& column : batch.columns()) {
    if (column.component == 0) fields.push_back(column.field);
    components = std::max(components, column.component + 1);
  }
  return Batch::of(fields, rows, components);
}

namespace {

// The columns of numbers in memory of their own, which outlives the received frame.
Batch copy_of(const Batch& batch) {
  Batch copy = columns_of(batch, batch.columns().front().count);
  each_column(batch, copy, [](const wire::Column&, auto from, auto to) { std::ranges::copy(from, to.begin()); });
  return copy;
}

}  // namespace

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
