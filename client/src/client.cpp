#include "client/src/client.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <variant>

#include "client/src/connection.hpp"
#include "client/src/resumed_nodes.hpp"
#include "client/src/session.hpp"
#include "client/src/sharded_connection.hpp"
#include "proto/wire/codec.hpp"

namespace shearbus {
namespace {

bool same_bytes(const wire::Request& a, const wire::Request& b) {
  return wire::encode_header(a) == wire::encode_header(b) && std::ranges::equal(a.batch.bytes(), b.batch.bytes());
}

// Refuses what a server that lacks the capability would ignore without a word.
void require(const wire::Welcome& welcome, const char* capability, bool asked) {
  if (!asked || std::ranges::find(welcome.capabilities, capability) != welcome.capabilities.end()) return;
  throw Error({.code = Code::kUnsupported,
               .text = fmt::format("the server (version {}) has no {}", welcome.server_version, capability),
               .remedy = "Use a newer server.",
               .field = capability});
}

}  // namespace

Client::Client(ClientOptions options) : Client(connect_to(std::move(options))) {}

Client::Client(std::shared_ptr<Connection> connection) : connection_(std::move(connection)) {
  wire::Request request;
  request.request_id = connection_->next_request_id();
  request.body = wire::Hello{.client_name = connection_->options().name};
  try {
    Received received = connection_->call(request, connection_->options().connect_deadline);
    welcome_ = std::move(body_of<wire::Welcome>(received));
    connection_->heed(welcome_);
  } catch (const Error& fault) {
    if (fault.status().code != Code::kUnknownOutcome) throw;
    // `hello` changes nothing on the server, so its unknown outcome means that no server answered.
    wire::Status status = fault.status();
    status.field = "endpoint";
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

void Client::set_reply_deadline(std::chrono::milliseconds deadline) {
  connection_->set_reply_deadline(deadline);
}

Session Client::open(std::string scene, std::string scene_file, std::span<const std::uint64_t> node_ids,
                     const OpenOptions& options) {
  require(welcome_, "idle_limit", options.idle_limit_s != 0);
  require(welcome_, "pairs", !options.nodes.pairs.empty());
  require(welcome_, "parameters", !options.nodes.parameters.empty());
  wire::Request request;
  auto& opening = request.body.emplace<wire::OpenSession>();
  for (const NodeOptions::Parameter& parameter : options.nodes.parameters) opening.parameters.push_back(parameter.key);
  request.batch = new_nodes(node_ids, options.nodes, opening.parameters);
  opening.pairs = options.nodes.pairs;
  opening.scene = std::move(scene);
  opening.scene_file = std::move(scene_file);
  opening.domain = options.domain;
  opening.check_closure = connection_->options().check_closure != CheckClosure::kOff;
  opening.idle_limit_s = options.idle_limit_s;
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

  SessionState session;
  session.connection = connection_;
  session.id = opening.session_id;
  session.resume_token = opening.resume_token;
  session.node_ids.assign(node_ids.begin(), node_ids.end());

  Received received;
  try {
    received = connection_->call(request, connection_->options().reply_deadline);
  } catch (const Error& fault) {
    if (!std::exchange(connection_->opening_undone, false)) connection_->opening_in_doubt = std::move(request);
    if (fault.status().code != Code::kUnknownOutcome) throw;
    wire::Status status = fault.status();
    status.remedy = "Open again with the same arguments: it is the same session, opened once.";
    throw Error(std::move(status));
  } catch (...) {
    connection_->opening_in_doubt = std::move(request);
    throw;
  }
  session.epoch = received.reply.epoch;
  session.opened = std::move(body_of<wire::SessionOpened>(received));
  session.start_checks(true);
  return Session(std::move(session));
}

Session Client::resume(const Session::Ticket& ticket, const ExpectedNodes& expected) {
  if (!expected.node_ids.empty()) {  // before the claim, which takes the session from its client
    wire::Request position;
    position.session_id = ticket.session_id;
    position.body = wire::ResumeSession{.resume_token = ticket.resume_token};
    Received asked = shearbus::ask(*connection_, std::move(position));
    // Several servers tell their scene and nodes only with the claim.
    if (!body_of<wire::SessionResumed>(asked).session.effective_scene.empty()) check_resumed_nodes(asked, expected);
  }
  ClaimInDoubt claim;
  Received received = claim_session(*connection_, ticket.session_id, ticket.resume_token, claim);
  SessionState session;
  session.connection = connection_;
  session.id = ticket.session_id;
  session.resume_token = ticket.resume_token;
  session.epoch = received.reply.epoch;
  check_resumed_nodes(received, expected);
  session.opened = std::move(body_of<wire::SessionResumed>(received).session);
  session.resumed = resumed_nodes(received.reply.batch, session.opened);
  if (std::string warning = nodes_left_out(received, expected); !warning.empty())
    session.opened.warnings.push_back(std::move(warning));
  session.adopt_position(received);
  session.start_checks(false);
  return Session(std::move(session));
}

template <typename Answer, typename Question>
Answer Client::ask(Question question) {
  Received received = shearbus::ask(*connection_, {.body = std::move(question)});
  return std::move(body_of<Answer>(received));
}

wire::ServerStatus Client::server_status() {
  return ask<wire::ServerStatus>(wire::ServerStatusQuery{});
}
wire::Checkpointed Client::checkpoint() {
  return ask<wire::Checkpointed>(wire::Checkpoint{});
}
wire::Draining Client::drain(bool exit, std::uint64_t within_s) {
  return ask<wire::Draining>(wire::Drain{.exit = exit, .within_s = within_s});
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

Received Client::top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count) {
  return shearbus::ask(*connection_, {.session_id = session, .body = wire::Inspect{.top = by, .count = count}});
}

wire::SessionClosed Client::close(const wire::SessionInfo& session) {
  Received received = shearbus::ask(*connection_, {.session_id = session.session_id,
                                                   .sequence = session.last_sequence + 1,
                                                   .body = wire::CloseSession{.reason = "closed by an operator"}});
  return body_of<wire::SessionClosed>(received);
}

}  // namespace shearbus
