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

Session::~Session() try {
  if (closed) return;
  wire::Request request = next_request();
  if (posted) ++request.sequence;  // the posted step runs before the closing request
  if (request.request_id == 0) request.request_id = connection->next_request_id();
  request.body = wire::CloseSession{.reason = "the client has gone"};
  connection->say(request);
} catch (const std::exception&) {
  // If there is no memory for the closing request, the session stays open on the server.
}

Batch Session::request(std::span<const Field> optional_columns, Form form) const {
  std::vector<Field> fields = wire::columns_in(form, opened.required_columns);
  fields.insert(fields.end(), optional_columns.begin(), optional_columns.end());
  return Batch::of(fields, node_ids.size(), opened.tangential_components);
}

Batch Session::request_for(std::span<const std::uint64_t> ids, std::span<const Field> optional_columns,
                           Form form) const {
  std::vector<Field> fields = {Field::kNodeId};
  for (const Field field : wire::columns_in(form, opened.required_columns)) fields.push_back(field);
  fields.insert(fields.end(), optional_columns.begin(), optional_columns.end());
  Batch batch = Batch::of(fields, ids.size(), opened.tangential_components);
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  return batch;
}

const StepResult& Session::finish_trial() {
  if (started_in_parts) {
    const Started started = std::move(*started_in_parts);
    started_in_parts.reset();
    return step_in_parts(started.columns, step_options, started.mode, std::exchange(posted, std::nullopt));
  }
  if (!posted)
    throw Error({.code = Code::kInvalidValue,
                 .text = "a step is finished that was not started",
                 .remedy = "Start a step first, and finish it once."});
  wire::Request request = std::move(*posted);
  posted.reset();
  return exchange_step(std::move(request));
}

std::uint64_t Session::commit() {
  state_version = exchange<wire::Committed>(wire::Commit{}).state_version;
  if (closure) closure->committed();
  return state_version;
}

std::uint64_t Session::rollback() {
  state_version = exchange<wire::RolledBack>(wire::Rollback{}).state_version;
  if (closure) closure->rolled_back();
  return state_version;
}

std::uint64_t Session::rollback_to(const std::string& mark) {
  const auto adopt_nodes = [&](Received& received) {
    const auto nodes = std::as_const(received.reply.batch).u64(Field::kNodeId);
    node_ids.assign(nodes.begin(), nodes.end());
    if (closure) closure->forget();
  };
  state_version = exchange<wire::RolledBack>(wire::Rollback{.to_mark = mark}, {}, adopt_nodes).state_version;
  return state_version;
}

wire::Marked Session::mark(const std::string& name) {
  return exchange<wire::Marked>(wire::Mark{.name = name});
}

void Session::register_nodes(std::span<const std::uint64_t> ids, std::span<const double> initial_temperature_k) {
  register_nodes(
      ids, NodeOptions{.initial_temperature_k = initial_temperature_k, .pairs = {}, .pair = {}, .parameters = {}});
}

void Session::register_nodes(std::span<const std::uint64_t> ids, const NodeOptions& options) {
  const auto adopt_nodes = [&](Received&) {
    node_ids.insert(node_ids.end(), ids.begin(), ids.end());
    if (closure) closure->forget();
  };
  exchange<wire::NodesChanged>(wire::RegisterNodes{.pairs = options.pairs}, new_nodes(ids, options, opened.parameters),
                               adopt_nodes);
}

void Session::retire_nodes(std::span<const std::uint64_t> ids) {
  exchange<wire::NodesChanged>(wire::RetireNodes{}, named_nodes(ids), [&](Received&) { remove_nodes(ids); });
}

TransferId Session::offer_nodes(std::span<const std::uint64_t> ids) {
  if (!in_doubt) offered = random_bytes();
  exchange<wire::NodesChanged>(wire::OfferNodes{.transfer_id = offered}, named_nodes(ids),
                               [&](Received&) { remove_nodes(ids); });
  return offered;
}

std::vector<std::uint64_t> Session::accept_nodes(const TransferId& transfer) {
  std::vector<std::uint64_t> nodes;
  exchange<wire::NodesChanged>(wire::AcceptNodes{.transfer_id = transfer}, {}, [&](Received& received) {
    const auto accepted = std::as_const(received.reply.batch).u64(Field::kNodeId);
    nodes.assign(accepted.begin(), accepted.end());
    node_ids.insert(node_ids.end(), nodes.begin(), nodes.end());
    if (closure) closure->forget();
  });
  return nodes;
}

Profiles Session::profiles(std::span<const std::uint64_t> ids, std::span<const double> pressure_pa) {
  if (!pressure_pa.empty() && pressure_pa.size() != ids.size())
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} pressures for {} nodes", pressure_pa.size(), ids.size()),
                 .remedy = "Give one per node, or none.",
                 .field = wire::name(Field::kPressure)});
  std::vector<Field> fields = {Field::kNodeId};
  if (!pressure_pa.empty()) fields.push_back(Field::kPressure);
  Batch nodes = Batch::of(fields, ids.size());
  std::ranges::copy(ids, nodes.u64(Field::kNodeId).begin());
  std::ranges::copy(pressure_pa, nodes.f64(Field::kPressure).begin());
  Received received = read_profiles(std::move(nodes));
  const auto& answer = body_of<wire::Profiles>(received);
  const Batch& rows = received.reply.batch;
  if (answer.nodes != ids.size() || rows.columns().empty() ||
      std::ranges::any_of(rows.columns(),
                          [&](const wire::Column& column) { return column.count != answer.nodes * answer.vertices; }))
    throw Error({.code = Code::kUnexpectedReply, .text = "the reply to read_profiles has other rows"});
  state_version = answer.state_version;
  return {
      .nodes = ids.size(), .vertices = answer.vertices, .state_version = answer.state_version, .rows = copy_of(rows)};
}

wire::SessionClosed Session::close() {
  const auto totals = exchange<wire::SessionClosed>(wire::CloseSession{});
  closed = true;
  end_checks();
  return totals;
}

void Session::forget_answers() {
  if (closure) closure->lag();
}

}  // namespace shearbus
