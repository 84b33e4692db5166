// Internal to the client library: the client's state of a session, the functions that send its requests, and body_of(),
// which returns the typed message in the header of a reply.
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

#include "client/src/closure_check.hpp"
#include "client/src/connection.hpp"
#include "client/src/input_check.hpp"
#include "client/src/options.hpp"

namespace shearbus {

std::array<std::uint8_t, 16> random_bytes();

// The body of a reply. Throws Error{kUnexpectedReply} if it is not the body that answers the request.
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

// True for a request of one of these kinds.
template <typename... Questions>
bool asks(const wire::Request& request) {
  return (std::holds_alternative<Questions>(request.body) || ...);
}

// A hash of the header, which holds the checksum of the payload unless `sum` leaves it out.
std::uint64_t hash_of(const wire::Request& request, wire::PayloadSum sum = wire::PayloadSum::kGiven);

// Sends a request that has no sequence number, with a new request id, and waits for the reply.
Received ask(Connection& connection, wire::Request request);

// A claim that was sent and not granted: a late copy may still be granted by the server of this epoch. 0: no claim.
struct ClaimInDoubt {
  std::uint64_t number = 0;
  std::uint64_t epoch = 0;
};

// Claims the session for this client: the server then refuses requests of other clients, even ones sent before the
// claim. The reply holds the last sequence number, the nodes and the offers of the session. Sets `in_doubt` to the claim
// if its outcome is unknown after an Error. after_own: claims only if the last claim that was granted is this client's;
// otherwise throws Error: SUPERSEDED.
Received claim_session(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token,
                       ClaimInDoubt& in_doubt, bool after_own = false);
// Makes the claim in doubt again. Throws Error: SUPERSEDED if another client was granted a claim, EPOCH after a restart.
Received repeat_claim(Connection& connection, const wire::SessionId& id, const wire::ResumeToken& token,
                      ClaimInDoubt& in_doubt);

// The payload of a request about some nodes: their ids; empty without nodes.
wire::Batch named_nodes(std::span<const std::uint64_t> node_ids);
// The payload of a request with new nodes, with the columns of their properties. `keys`: parameters of the session.
wire::Batch new_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options,
                      std::span<const std::string> keys);

// Changes the nodes of a session, in the order of the rows, as the answered request has changed them on the server.
void change_nodes(std::vector<std::uint64_t>& node_ids, const wire::Request& request, const Batch& answer);

// What a client has of a session, and how its requests are sent.
struct SessionState {
  std::shared_ptr<Connection> connection;
  wire::SessionId id{};
  wire::ResumeToken resume_token{};
  std::uint64_t epoch = 0;
  std::vector<std::uint64_t> node_ids;  // in the order of the rows
  wire::SessionOpened opened;           // the reply to the opening: scene, strategy, columns of a step, warnings, ...
  std::uint64_t last_sequence = 0;      // of the last answered request; 0 is the opening
  std::uint64_t state_version = 0;      // as the last answer told it
  ResumedNodes resumed;
  struct InDoubt {  // a request with unknown outcome, which a repeated call must send with the same bytes
    std::uint64_t request_id = 0;
    std::uint64_t epoch = 0;
    std::uint64_t payload = 0;  // hash of its payload
  };
  std::optional<InDoubt> in_doubt;
  ClaimInDoubt claim_in_doubt;
  std::vector<TransferId> offers;       // of a resumed session, which no session had accepted when it was resumed
  TransferId offered{};                 // id of the last offer, used again if its outcome is unknown
  std::optional<wire::Request> posted;  // request of start_trial(), whose reply finish_trial() will receive
  bool closed = false;
  StepResult result;
  std::optional<ClosureCheck> closure;  // compares jumps of the host with answered ones; absent: switched off
  std::optional<InputCheck> inputs;     // warns of doubtful inputs of a session that this client opened
  StepOptions step_options;             // options of the present step

  void start_checks(bool from_the_start);  // unless the options of the connection have check_closure = off
  void end_checks() noexcept;
  void check_answered(const Batch& request, const wire::Reply& reply) noexcept;
  wire::Request next_request() const;
  void give_id(wire::Request& request);
  void keep_in_doubt(const wire::Request& request) noexcept;

  // Sends the session's next request, which may get another id or epoch. The sequence number advances only when the
  // reply has arrived and adopt() has taken it over. A request without a reply keeps its id, so that a repeated call has
  // the same bytes and the server recognises it; the same holds if adopt() has no memory.
  Received exchange(wire::Request& request);
  template <typename Answer, typename Question>
  Answer exchange(Question question, wire::Batch batch = {}) {
    wire::Request request = next_request();
    request.body = std::move(question);
    request.batch = std::move(batch);
    Received received = exchange(request);
    return std::move(body_of<Answer>(received));
  }
  // Takes over the nodes that the session has after a request. Throws Error{kUnexpectedReply} if the reply does not answer
  // the request.
  void adopt(const wire::Request& request, Received& received);
  // Adopts sequence number, nodes and offers from the reply `session_resumed`.
  void adopt_position(Received& where);

  // A step in parts that began and has not ended.
  struct StepInParts {
    // A part that may have been sent and was not answered: it must be sent again with the same bytes.
    struct Sent {
      std::uint64_t request_id = 0;  // 0: the part was not sent
      std::uint64_t epoch = 0;
      std::uint64_t follows = 0;
    };
    std::uint64_t hash = 0;      // of the step, to recognise its repetition
    std::uint32_t answered = 0;  // number of parts
    Sent next;                   // the part behind the answered ones
    Sent behind;                 // the part behind that one
    Received whole;              // the answer, as far as there is one
  };
  std::optional<StepInParts> in_parts;
  // A step in parts failed after its first part had committed the trial before: a repetition must not commit again.
  bool previous_committed = false;
  std::optional<Batch> started_in_parts;  // a view of the columns of the step of start(), if it is in parts

  bool needs_parts(const Batch& columns) const;
  std::uint32_t parts_of(std::size_t rows) const;
  Batch part_rows(const Batch& columns, std::uint32_t part) const;
  wire::Request part_request(Batch rows, const wire::Downscale& step, std::uint32_t part, std::uint32_t parts) const;
  wire::Request part_behind(const wire::Request& before, Batch rows);
  const StepResult& step_in_parts(const Batch& columns, const StepOptions& options, std::optional<wire::Request> first);
  void copy_part(const Received& part, std::size_t first_row) noexcept;
  void add_part(const Received& part);

  wire::Request step_request(const Batch& columns, const StepOptions& options);
  const StepResult& exchange_step(wire::Request request);
  // Makes a step. In the mode kTrial the new states wait for commit(), which keeps them, or rollback().
  const StepResult& step(const Batch& columns, const StepOptions& options);
  // step() in two halves, for a host with other work to do while the server steps the layers: start() sends the request,
  // finish() waits for the reply with the deadline and the retries of any call. Between the two the caller leaves
  // `columns` unchanged and makes no other call on the session. If finish() throws, step() with the same values is the
  // same request.
  void start(const Batch& columns, const StepOptions& options);
  const StepResult& finish();
  void post(wire::Request& request);

  // Sends a request and waits for the reply, across restarts of the server.
  Received call(wire::Request& request);
  // Reads the profiles of the nodes in a batch, with their pressures if it has them.
  Received read_profiles(Batch nodes);

 private:
  void resynchronise();
  void follow_restart(wire::Request& request, const Error& fault);
};

class Session : public SessionState {
 public:
  explicit Session(SessionState&& state) : SessionState(std::move(state)) {}
  Session(Session&& other) noexcept : SessionState(static_cast<SessionState&&>(other)) { other.closed = true; }
  Session& operator=(Session&& other) noexcept {
    std::swap<SessionState>(*this, other);  // the destructor of `other` closes the session that was here
    return *this;
  }
  ~Session();  // closes a session that is still open, without waiting for the reply

  const StepResult& advance(const Batch& request, const StepOptions& options) { return step(request, options); }
  const StepResult& trial(const Batch& request, StepOptions options) {
    options.mode = wire::Mode::kTrial;
    return step(request, options);
  }
  void forget_answers();  // the host went on without the server: the next step is not compared with an answer
  std::uint64_t commit();
  std::uint64_t rollback();
  // Stores the committed states on the server under a name, such as that of the host's restart dump; the server keeps
  // the newest welcome().limits.max_marks marks. rollback_to() restores the nodes of a mark with their states and drops
  // a trial.
  wire::Marked mark(const std::string& name);
  std::uint64_t rollback_to(const std::string& mark);
  // The calls from register_nodes() to accept_nodes() change the set of nodes and are refused while the session has a
  // trial. New nodes are added after the present nodes, which keep their order.
  void register_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options = {});
  void retire_nodes(std::span<const std::uint64_t> node_ids);  // removes the nodes with their states
  // Moves nodes with their states to another session of the domain: that session passes the returned id to
  // accept_nodes(). Between the two calls the server keeps the nodes. The offering session may accept its own offer.
  TransferId offer_nodes(std::span<const std::uint64_t> node_ids);
  std::span<const std::uint64_t> accept_nodes(const TransferId& transfer);  // those of node_ids that were accepted
  // Reads the profiles of some nodes from their committed states. `pressure_pa`: P at which the flow stress is
  // evaluated, one value per node; empty: 0. Returns a reply `profiles` whose columns have the shape [nodes * vertices],
  // the vertices of a node in ascending z; NaN: the vertex lies outside of the layer and the quantity is one of the layer.
  // Throws Error: kUnsupported for a scene that keeps no profile, kLimit for more rows than a message holds
  // (welcome().limits.max_rows_per_message).
  Received profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa = {});
  wire::SessionClosed close();

  // Lets another process continue this session after this process has ended. The ticket is a secret: its holder owns
  // the session.
  struct Ticket {
    wire::SessionId session_id{};
    wire::ResumeToken resume_token{};
  };
  Ticket ticket() const { return {.session_id = id, .resume_token = resume_token}; }
  void leave() { closed = true; }  // leaves the session open on the server, to be resumed
};

// Returns zeroed columns of `rows` values: those of another batch, by field and component.
Batch columns_of(const Batch& batch, std::size_t rows);

// Calls copy(column, from, to) with the values of each column of a batch, and those of the same column of another.
template <typename Copy>
void each_column(const Batch& from, Batch& to, const Copy& copy) {
  for (const wire::Column& column : to.columns()) {
    if (column.element == wire::Element::kUint8)
      copy(column, from.u8(column.field), to.u8(column.field));
    else if (column.element == wire::Element::kUint64)
      copy(column, from.u64(column.field), to.u64(column.field));
    else
      copy(column, from.f64(column.field, column.component), to.f64(column.field, column.component));
  }
}

// Adds counts, largest closure and warnings of one answer to `sum`; not state version or times.
void add_rows(wire::Upscale& sum, const wire::Upscale& some);
void add_warnings(std::vector<std::string>& all, std::span<const std::string> some);  // those that are not there yet

}  // namespace shearbus
