// Replies as values to header messages and back.
#include <fmt/format.h>

#include "proto/wire/header_message.hpp"
#include "proto/wire/status_message.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::wire {
namespace {

void put(const Welcome& from, v1::ReplyHeader& header) {
  v1::Welcome& to = *header.mutable_welcome();
  to.set_protocol_major(from.protocol_major);
  to.set_protocol_minor(from.protocol_minor);
  to.set_server_version(as_utf8(from.server_version, kMaxTextBytes));
  to.mutable_limits()->set_max_header_bytes(from.limits.max_header_bytes);
  to.mutable_limits()->set_max_payload_bytes(from.limits.max_payload_bytes);
  to.mutable_limits()->set_max_nodes_per_session(from.limits.max_nodes_per_session);
  to.mutable_limits()->set_max_sessions(from.limits.max_sessions);
  to.mutable_limits()->set_max_marks(from.limits.max_marks);
  to.mutable_limits()->set_max_frames(from.limits.max_frames);
  to.mutable_limits()->set_max_state_bytes(from.limits.max_state_bytes);
  for (const std::string& capability : from.capabilities) to.add_capabilities(as_utf8(capability, kMaxTextBytes));
  to.set_durability(as_utf8(from.durability, kMaxTextBytes));
  to.set_access(as_utf8(from.access, kMaxTextBytes));
}
using ColumnNumbers = google::protobuf::RepeatedField<std::uint32_t>;

void put_columns(const std::vector<Field>& from, ColumnNumbers& to) {
  for (const Field field : from) to.Add(static_cast<std::uint32_t>(field));
}

// A newer server may name columns that this side does not know: it does not ask for them.
std::vector<Field> take_columns(const ColumnNumbers& from) {
  std::vector<Field> fields;
  for (const std::uint32_t number : from)
    if (number != 0 && v1::Field_IsValid(static_cast<int>(number))) fields.push_back(static_cast<Field>(number));
  return fields;
}

void put(const SessionOpened& from, v1::SessionOpened& to) {
  to.set_effective_scene(scene_text(from.effective_scene, "session_opened.effective_scene"));
  to.set_bytes_per_node(from.bytes_per_node);
  for (const std::string& warning : from.warnings) to.add_warnings(as_utf8(warning, kMaxTextBytes));
  to.set_strategy(static_cast<v1::Strategy>(from.strategy));
  to.set_tangential_components(from.tangential_components);
  put_columns(from.required_columns, *to.mutable_required_columns());
  put_columns(from.optional_columns, *to.mutable_optional_columns());
  put_columns(from.reply_columns, *to.mutable_reply_columns());
  put_columns(from.columns_on_request, *to.mutable_columns_on_request());
  to.set_scene_name(as_utf8(from.scene_name, kMaxTextBytes));
}
void put(const SessionOpened& from, v1::ReplyHeader& header) {
  put(from, *header.mutable_session_opened());
}
void put(const SessionResumed& from, v1::ReplyHeader& header) {
  v1::SessionResumed& to = *header.mutable_session_resumed();
  put(from.session, *to.mutable_session());
  to.set_last_sequence(from.last_sequence);
  to.set_state_version(from.state_version);
  to.set_trial_stands(from.trial_stands);
  to.set_claim(from.claim);
  for (const TransferId& offer : from.offers) to.add_offers(id_bytes(offer));
}
void put(const Upscale& from, v1::ReplyHeader& header) {
  v1::Upscale& to = *header.mutable_upscale();
  to.set_nodes(from.nodes);
  to.set_state_version(from.state_version);
  to.set_solver_ns(from.solver_ns);
  to.set_service_ns(from.service_ns);
  to.set_flagged_nodes(from.flagged_nodes);
}
void put(const Committed& from, v1::ReplyHeader& header) {
  header.mutable_committed()->set_state_version(from.state_version);
}
void put(const RolledBack& from, v1::ReplyHeader& header) {
  header.mutable_rolled_back()->set_state_version(from.state_version);
}
void put(const Marked& from, v1::ReplyHeader& header) {
  v1::Marked& to = *header.mutable_marked();
  to.set_state_version(from.state_version);
  for (const std::string& mark : from.names) to.add_names(as_utf8(mark, kMaxTextBytes));
}
void put(const NodesChanged& from, v1::ReplyHeader& header) {
  header.mutable_nodes_changed()->set_nodes(from.nodes);
}
void put(const SessionClosed& from, v1::ReplyHeader& header) {
  v1::SessionClosed& to = *header.mutable_session_closed();
  to.set_requests(from.requests);
  to.set_node_steps(from.node_steps);
  to.set_solver_ns(from.solver_ns);
  to.set_asleep_node_steps(from.asleep_node_steps);
}
void put(const ServerStatus& from, v1::ReplyHeader& header) {
  to_message(from, *header.mutable_server_status());
}
void put(const Inspected& from, v1::ReplyHeader& header) {
  to_message(from, *header.mutable_inspected());
}
void put(const Checkpointed& from, v1::ReplyHeader& header) {
  header.mutable_checkpointed()->set_bytes(from.bytes);
  header.mutable_checkpointed()->set_duration_ns(from.duration_ns);
}
void put(const Draining& from, v1::ReplyHeader& header) {
  header.mutable_draining()->set_sessions(from.sessions);
}
void put(const std::monostate&, v1::ReplyHeader&) {}

void put_status(const Status& from, v1::Status& to) {
  to.set_code(static_cast<v1::Code>(from.code));
  to.set_text(as_utf8(from.text, kMaxSceneBytes));
  to.set_remedy(as_utf8(from.remedy, kMaxTextBytes));
  to.set_field(as_utf8(from.field, kMaxTextBytes));
  const std::size_t named = std::min(from.node_ids.size(), kMaxNodesNamed);
  to.mutable_node_ids()->Add(from.node_ids.begin(), from.node_ids.begin() + static_cast<std::ptrdiff_t>(named));
  to.set_last_sequence(from.last_sequence);
}

Welcome take(const v1::Welcome& from) {
  return {.protocol_major = from.protocol_major(),
          .protocol_minor = from.protocol_minor(),
          .server_version = from.server_version(),
          .limits = {.max_header_bytes = from.limits().max_header_bytes(),
                     .max_payload_bytes = from.limits().max_payload_bytes(),
                     .max_nodes_per_session = from.limits().max_nodes_per_session(),
                     .max_sessions = from.limits().max_sessions(),
                     .max_marks = from.limits().max_marks(),
                     .max_frames = from.limits().max_frames(),
                     .max_state_bytes = from.limits().max_state_bytes()},
          .capabilities = {from.capabilities().begin(), from.capabilities().end()},
          .durability = from.durability(),
          .access = from.access()};
}
SessionOpened take(const v1::SessionOpened& from) {
  if (from.effective_scene().empty())
    refuse(Code::kMalformed, "session_opened has no effective scene", "session_opened.effective_scene");
  return {.effective_scene = from.effective_scene(),
          .bytes_per_node = from.bytes_per_node(),
          .warnings = {from.warnings().begin(), from.warnings().end()},
          .strategy = static_cast<Strategy>(from.strategy()),
          .tangential_components = from.tangential_components(),
          .required_columns = take_columns(from.required_columns()),
          .optional_columns = take_columns(from.optional_columns()),
          .reply_columns = take_columns(from.reply_columns()),
          .columns_on_request = take_columns(from.columns_on_request()),
          .scene_name = from.scene_name()};
}
SessionResumed take(const v1::SessionResumed& from) {
  if (static_cast<std::size_t>(from.offers_size()) > kMaxOffers)
    refuse(Code::kLimit, fmt::format("{} offers, at most {} allowed", from.offers_size(), kMaxOffers),
           "session_resumed.offers");
  SessionResumed to{.session = take(from.session()),
                    .last_sequence = from.last_sequence(),
                    .state_version = from.state_version(),
                    .trial_stands = from.trial_stands(),
                    .claim = from.claim(),
                    .offers = {}};
  for (const std::string& offer : from.offers())
    to.offers.push_back(id_from(bytes_of(offer), "session_resumed.offers"));
  return to;
}
Upscale take(const v1::Upscale& from) {
  return {.nodes = from.nodes(),
          .state_version = from.state_version(),
          .solver_ns = from.solver_ns(),
          .service_ns = from.service_ns(),
          .flagged_nodes = from.flagged_nodes()};
}
SessionClosed take(const v1::SessionClosed& from) {
  return {.requests = from.requests(),
          .node_steps = from.node_steps(),
          .solver_ns = from.solver_ns(),
          .asleep_node_steps = from.asleep_node_steps()};
}
Status take_status(const v1::Status& from) {
  if (static_cast<std::size_t>(from.node_ids_size()) > kMaxNodesNamed)
    refuse(Code::kLimit, fmt::format("status names {} nodes, at most {} allowed", from.node_ids_size(), kMaxNodesNamed),
           "status.node_ids");
  if (from.code() == v1::CODE_UNSPECIFIED) refuse(Code::kMalformed, "the reply has no status code", "status.code");
  return {.code = static_cast<Code>(from.code()),
          .text = from.text(),
          .remedy = from.remedy(),
          .field = from.field(),
          .node_ids = {from.node_ids().begin(), from.node_ids().end()},
          .last_sequence = from.last_sequence()};
}

}  // namespace

void to_message(const Reply& reply, v1::ReplyHeader& message) {
  put_header(reply, message);
  std::visit([&](const auto& body) { put(body, message); }, reply.body);
  put_status(reply.status, *message.mutable_status());
  message.set_replayed(reply.replayed);
}

void from_message(const v1::ReplyHeader& header, Reply& message) {
  message.replayed = header.replayed();
  message.status = take_status(header.status());
  const bool has_body = header.body_case() != v1::ReplyHeader::BODY_NOT_SET;
  if (has_body != message.status.ok())
    refuse(Code::kMalformed,
           fmt::format("reply of status {} has {} body", name(message.status.code), has_body ? "a" : "no"), "body");
  switch (header.body_case()) {
    case v1::ReplyHeader::kWelcome:
      message.body = take(header.welcome());
      break;
    case v1::ReplyHeader::kSessionOpened:
      message.body = take(header.session_opened());
      break;
    case v1::ReplyHeader::kUpscale:
      message.body = take(header.upscale());
      break;
    case v1::ReplyHeader::kCommitted:
      message.body = Committed{header.committed().state_version()};
      break;
    case v1::ReplyHeader::kRolledBack:
      message.body = RolledBack{header.rolled_back().state_version()};
      break;
    case v1::ReplyHeader::kSessionClosed:
      message.body = take(header.session_closed());
      break;
    case v1::ReplyHeader::kServerStatus:
      message.body = from_message(header.server_status());
      break;
    case v1::ReplyHeader::kMarked:
      message.body = Marked{.state_version = header.marked().state_version(),
                            .names = {header.marked().names().begin(), header.marked().names().end()}};
      break;
    case v1::ReplyHeader::kNodesChanged:
      message.body = NodesChanged{header.nodes_changed().nodes()};
      break;
    case v1::ReplyHeader::kSessionResumed:
      message.body = take(header.session_resumed());
      break;
    case v1::ReplyHeader::kCheckpointed:
      message.body =
          Checkpointed{.bytes = header.checkpointed().bytes(), .duration_ns = header.checkpointed().duration_ns()};
      break;
    case v1::ReplyHeader::kDraining:
      message.body = Draining{.sessions = header.draining().sessions()};
      break;
    case v1::ReplyHeader::kInspected:
      message.body = from_message(header.inspected());
      break;
    case v1::ReplyHeader::BODY_NOT_SET:
      break;
  }
}

}  // namespace shearbus::wire
