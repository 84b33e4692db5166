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
  return state_version = exchange<wire::RolledBack>(wire::Rollback{.to_mark = mark}).state_version;
}

wire::Marked Session::mark(const std::string& name) {
  return exchange<wire::Marked>(wire::Mark{.name = name});
}

void Session::register_nodes(std::span<const std::uint64_t> ids, const NodeOptions& options) {
  exchange<wire::NodesChanged>(wire::RegisterNodes{.pairs = options.pairs}, new_nodes(ids, options, opened.parameters));
}

void Session::retire_nodes(std::span<const std::uint64_t> ids) {
  exchange<wire::NodesChanged>(wire::RetireNodes{}, named_nodes(ids));
}

TransferId Session::offer_nodes(std::span<const std::uint64_t> ids) {
  if (!in_doubt) offered = random_bytes();
  exchange<wire::NodesChanged>(wire::OfferNodes{.transfer_id = offered}, named_nodes(ids));
  return offered;
}

std::span<const std::uint64_t> Session::accept_nodes(const TransferId& transfer) {
  const std::size_t before = node_ids.size();
  exchange<wire::NodesChanged>(wire::AcceptNodes{.transfer_id = transfer});
  return std::span(node_ids).subspan(before);
}

Received Session::profiles(std::span<const std::uint64_t> ids, std::span<const double> pressure_pa) {
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
  const auto& columns = received.reply.batch.columns();
  if (answer.nodes != ids.size() || columns.empty() || std::ranges::any_of(columns, [&](const wire::Column& column) {
        return column.count != answer.nodes * answer.vertices;
      }))
    throw Error({.code = Code::kUnexpectedReply, .text = "the reply to read_profiles has other rows"});
  state_version = answer.state_version;
  return received;
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
