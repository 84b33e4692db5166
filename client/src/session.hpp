// What client.cpp and session.cpp share: a session's memory of where it stands, and how replies are read.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "client/include/shearbus/client.hpp"
#include "client/src/connection.hpp"

namespace shearbus {

std::array<std::uint8_t, 16> random_bytes();

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

// A request that is no step of a session, under an id of its own.
Received ask(Connection& connection, wire::Request request);

// Makes the session this client's: what others have sent, or sent late, does not run any more. Tells where it stands.
Received claim_session(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token);

// Columns of an opening, or of a change of nodes; nothing of no nodes.
wire::Batch named_nodes(std::span<const std::uint64_t> node_ids, std::span<const double> temperatures = {});

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

  wire::Request next_request() const;

  // Sends the session's next request. Only an answered one counts. One without an answer keeps its id, so that the same
  // call again has the same bytes and the server knows it.
  Received exchange(wire::Request request);
  template <typename Answer, typename Question>
  Received exchange(Question question, wire::Batch batch = {}) {
    wire::Request request = next_request();
    request.body = std::move(question);
    request.batch = std::move(batch);
    Received received = exchange(std::move(request));
    body_of<Answer>(received);
    return received;
  }

  // Stands where the server says that the session stands.
  void stand_where(Received& where);
  void forget(std::span<const std::uint64_t> nodes);

  wire::Request step_request(const Batch& columns, const StepOptions& options, wire::Mode mode) const;
  const StepResult& take(wire::Request request);
  const StepResult& step(const Batch& columns, const StepOptions& options, wire::Mode mode);
  Batch columns(std::span<const Field> optional_columns, bool with_node_ids, std::size_t count) const;

 private:
  void take_up();
  Received call(wire::Request& request);
  void follow_restart(wire::Request& request, const Error& fault);
};

}  // namespace shearbus
