// The C++ client of the shearbus subgrid service.
//
//   shearbus::Client client({.endpoint = "ipc:///run/user/1000/shearbus/bus"});
//   shearbus::Session session = client.open(scene_text, "scene.toml", node_ids);
//   auto request = session.request();                       // columns of the scene's strategy, to be filled in
//   std::ranges::copy(jumps, request.f64(Field::kVelocityJump).begin());
//   const shearbus::StepResult& result = session.advance(request, {.dt_s = 1e-9});
//   result.shear_stress_pa(); ...
//
// Every call has a deadline and throws shearbus::Error on failure: the code and text of the server's refusal,
// kUnreachable, kAuth (the server does not admit this client), kUnknownOutcome (no reply before the deadline, retries
// included: the step may or may not have run), kUnexpectedReply or kNotClosed (ClientOptions::check_closure). After
// kUnknownOutcome the same call with the same values is the same request: if the request has run, the server does not
// run it again and sends the kept reply. The server refuses a different call with kSequenceReused if the lost request
// has run; the session then continues after the lost request.
//
// The sessions of a durable server (welcome().durability) outlive the server: calls wait for the restarted server until
// their deadline and then continue. They throw kEpoch if the server was restored with older states.
// A client and its sessions belong to one thread; different clients are independent. All quantities are in SI units.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {

using wire::AbsentNodes;
using wire::Batch;
using wire::Code;
using wire::Error;
using wire::Field;
using wire::Form;
using wire::Policy;
using wire::Status;
using wire::TransferId;

// The closure check of force-driven sessions. A reply holds the stress and the velocity jump that this stress causes; a
// host that applies the stress must therefore send this jump in its next step, except for rounding. kWarn compares the
// two in the first 100 steps and warns once of a difference, with the likely mistake of the host; in sessions of both
// strategies it also warns of doubtful times and inputs (input_check.hpp). kError throws kNotClosed in place of a step
// that differs. kOff, without warnings, is for hosts whose jump has other causes, for instance a turning interface.
enum class CheckClosure { kOff, kWarn, kError };

struct ClientOptions {
  // tcp://host:port, ipc://path, inproc://name, or file://path of a server's endpoint file. Several endpoints with a
  // comma between them, or file://path of a directory of endpoint files: the nodes are divided over these servers
  // (proto/WIRE.md, "Several servers").
  std::string endpoint;
  void* context = nullptr;  // libzmq context to use; required for inproc; null: a context of its own
  std::string server_key;   // tcp: the server's public CURVE key; empty: that of the endpoint file, or no encryption
  std::string secret_key;   // this client's secret key, required with server_key
  std::string name = "shearbus-client";               // name of this client in the server's log
  std::chrono::milliseconds connect_deadline{5'000};  // deadline of connecting and the first exchange
  std::chrono::milliseconds reply_deadline{60'000};   // deadline of any other call, retries included
  std::chrono::milliseconds retry_after{5'000};       // time after which the request is repeated on a fresh socket
  bool wait_for_recovery = true;  // a call to a server that recovers its sessions waits as long as that takes
  CheckClosure check_closure = CheckClosure::kWarn;
  // Called from inside a call that has waited for 2 s, then after 4, 8, ... s, with what the call waits for; and with
  // "warning: " followed by a warning about a step. Without a log function warnings go to standard error, and from 10 s
  // on so does what a call waits for.
  std::function<void(const std::string& line)> log;
  // Called from inside a call that waits, every 0.1 s and after each signal. True: the call ends as if its deadline had
  // passed.
  std::function<bool()> interrupted;
  // A directory or a new file that gets event logs of this client's sessions (proto/files/event_log.md); empty: none.
  std::string record;
};

// Gives a line to a log, or without one to standard error.
void write_line(const std::function<void(const std::string& line)>& log, const std::string& line);

// A new pair of CURVE keys, each of 40 characters.
struct KeyPair {
  std::string public_key;
  std::string secret_key;
};
KeyPair make_key_pair();

// Properties of new nodes by which they differ from the scene. All lists have one value per node or are empty.
struct NodeOptions {
  std::span<const double> initial_temperature_k;  // empty: the value of the scene
  // The material pair of each node: `pair` holds places in `pairs`, names of tables [pair.NAME] of the scene; the name ""
  // stands for the tables outside of them. Empty: all nodes have the constants of these.
  std::vector<std::string> pairs;
  std::span<const std::uint64_t> pair;
  // Numbers of the scene that have another value for each node, by their keys, as "interface.friction_coefficient". The
  // opening of a session chooses the keys; later nodes give values for all of them, or for none: then they have those of
  // their pairs.
  struct Parameter {
    std::string key;
    std::span<const double> values;  // in the key's unit
  };
  std::vector<Parameter> parameters;
};

// What the host of a resumed session takes its nodes for. Nodes, pairs and parameters that are given must be those of the
// session; empty lists, and the initial temperatures, are not compared.
struct ExpectedNodes {
  std::span<const std::uint64_t> node_ids;
  NodeOptions options;
};

// The nodes of a resumed session as the server told them, in the order that they had then. Without pairs and parameters in
// the scene, and if the server did not tell, the lists of these are empty.
struct ResumedNodes {
  std::vector<std::uint64_t> node_ids;
  std::vector<std::uint64_t> pair;              // 0: the tables outside of the pairs; i: the i-th pair of the scene
  std::vector<std::vector<double>> parameters;  // values of each key of the session
};

struct OpenOptions {
  std::span<const double> initial_temperature_k;  // one value per node; empty: the value of the scene
  // Node ids are unique among the sessions of a domain, such as the ranks of one run, and nodes can move between these
  // sessions. Empty: the session is in no domain, and must be opened with at least one node.
  std::string domain;
  std::uint64_t idle_limit_s = 0;  // the server closes the session after this time without a request; 0: never
  // As in NodeOptions.
  std::vector<std::string> pairs = {};
  std::span<const std::uint64_t> pair = {};
  std::vector<NodeOptions::Parameter> parameters = {};
};

struct StepOptions {
  double dt_s = 0.0;
  double time_s = 0.0;     // end of the step, for records only
  std::uint64_t step = 0;  // the host's step number, for records only
  std::uint32_t attempt = 0;
  bool commit_previous = false;  // true: first commits the trial of the step before
  // By default a node without an answer keeps its state and its row has the outcome kFailed. With kAllOrNothing the
  // call throws kStepFailed with the ids of such nodes, and no state changes.
  Policy policy = Policy::kAccept;
  // Effect of a request_for() on the other nodes of the session. kOpen: they are stepped with P = 0, jump 0 and no
  // forces, so that they cool; the result has no rows of them.
  AbsentNodes absent_nodes = AbsentNodes::kKeep;
};

// The reply to a step. A column has one value per row of the request, in the order of the request, and is valid until
// the session's next call. Tangential columns have a second component, with index 1, if the scene has
// tangential_components = 2.
class StepResult {
 public:
  std::span<const double> shear_stress_pa(std::uint32_t component = 0) const {
    return reply_.batch.f64(Field::kShearStress, component);
  }
  std::span<const double> sliding_velocity_m_per_s(std::uint32_t component = 0) const {
    return reply_.batch.f64(Field::kSlidingVelocity, component);
  }
  std::span<const double> interface_temperature_k() const { return reply_.batch.f64(Field::kInterfaceTemperature); }
  std::span<const double> velocity_jump_new_m_per_s(std::uint32_t component = 0) const {
    return reply_.batch.f64(Field::kVelocityJumpNew, component);
  }
  std::span<const double> friction_heat_j_per_m2() const { return reply_.batch.f64(Field::kFrictionHeat); }
  const Batch& batch() const { return reply_.batch; }  // all columns of the reply
  std::span<const std::uint8_t> regime() const { return reply_.batch.u8(Field::kRegime); }
  std::span<const std::uint8_t> outcome() const { return reply_.batch.u8(Field::kOutcome); }
  bool replayed() const {
    return reply_.replayed;
  }  // true: the kept answer to a request that the server had run before
  const wire::Upscale& upscale() const { return std::get<wire::Upscale>(reply_.body); }
  std::chrono::nanoseconds round_trip() const { return round_trip_; }

 private:
  friend class Session;
  std::shared_ptr<void> payload_frame_;  // the received frame, which the columns point into
  wire::Reply reply_;
  std::chrono::nanoseconds round_trip_{0};
};

// Profiles of nodes across the layer: columns kPosition to kLayerShearStress of proto/wire/columns.inc, as far as the
// scene has them, each of shape [nodes * vertices], the vertices of a node in ascending z. Positions and widths are the
// same for all nodes. NaN: the vertex lies outside of the layer and the quantity is one of the layer.
struct Profiles {
  std::size_t nodes = 0;
  std::size_t vertices = 0;
  std::uint64_t state_version = 0;  // number of commits that led to these states
  Batch rows;

  // The values of all nodes; empty if the scene does not have the quantity.
  std::span<const double> of(Field field, std::uint32_t component = 0) const { return rows.f64(field, component); }
};

class Connection;  // owns the socket and applies deadlines and retries
struct Received;

class Session {
 public:
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;
  ~Session();  // closes a session that is still open, without waiting for the reply

  // The required columns of a step of all nodes, with rows in the order of node_ids(), zeroed, and the given optional
  // columns. A force-driven request has one of two forms: stresses and masses of both half zones (kFarField), or stick
  // stress and impedance (kStick).
  Batch request(std::span<const Field> optional_columns = {}, Form form = Form::kFarField) const;
  // Like request(), for a step of some nodes, with rows in the order of `node_ids`.
  Batch request_for(std::span<const std::uint64_t> node_ids, std::span<const Field> optional_columns = {},
                    Form form = Form::kFarField) const;

  const StepResult& advance(const Batch& request, const StepOptions& step);  // steps and commits the new states
  // steps like advance(), but the new states are only a trial until commit() keeps or rollback() drops them
  const StepResult& trial(const Batch& request, const StepOptions& step);
  // trial() in two halves, for a host with other work to do while the server steps the layers: start_trial() sends the
  // request, finish_trial() waits for the reply with the deadline and the retries of any call. Between the two the
  // caller leaves `request` unchanged and makes no other call on the session. If finish_trial() throws, trial() with
  // the same values is the same request.
  // start_advance() is the same for advance(); finish_trial() then returns the committed result.
  void start_trial(const Batch& request, const StepOptions& step);
  void start_advance(const Batch& request, const StepOptions& step);
  const StepResult& finish_trial();
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
  void register_nodes(std::span<const std::uint64_t> node_ids,
                      std::span<const double> initial_temperature_k = {});  // one per node; empty: scene's value
  void register_nodes(std::span<const std::uint64_t> node_ids, const NodeOptions& options);
  void retire_nodes(std::span<const std::uint64_t> node_ids);  // removes the nodes with their states
  // Moves nodes with their states to another session of the domain: that session passes the returned id to
  // accept_nodes(). Between the two calls the server keeps the nodes. The offering session may accept its own offer.
  TransferId offer_nodes(std::span<const std::uint64_t> node_ids);
  std::vector<std::uint64_t> accept_nodes(const TransferId& transfer);
  // Reads the profiles of some nodes from their committed states. `pressure_pa`: P at which the flow stress is
  // evaluated, one value per node; empty: 0. Throws Error: kUnsupported for a scene that keeps no profile, kLimit for
  // more rows than a message holds (welcome().limits.max_rows_per_message).
  Profiles profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa = {});
  wire::SessionClosed close();

  // Columns of the replies to later steps; an empty list asks for all default columns of the session.
  void want(std::vector<Field> columns);
  const std::string& effective_scene()
      const;  // canonical TOML text with every default and constant, as the server understood it
  const wire::SessionOpened& opened() const;  // the reply to the opening: scene, strategy, columns of a step, ...
  const std::vector<std::string>& warnings() const;
  std::uint64_t bytes_per_node() const;
  const std::vector<std::uint64_t>& node_ids() const;  // node ids in the order of the rows

  // Lets another process continue this session after this process has ended. The ticket is a secret: its holder owns
  // the session.
  struct Ticket {
    wire::SessionId session_id{};
    wire::ResumeToken resume_token{};
  };
  Ticket ticket() const;
  // Offers of a resumed session that no session had accepted when this client resumed it.
  const std::vector<TransferId>& offers() const;
  std::uint64_t last_sequence() const;  // number of the last answered request; 0 is the opening
  std::uint64_t state_version() const;  // number of commits so far, as the last answer told it
  const ResumedNodes& resumed_nodes() const;
  void leave();  // leaves the session open on the server, to be resumed

 private:
  friend class Client;
  friend class ShardedConnection;
  friend class ShardedSession;
  struct Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

class Client {
 public:
  explicit Client(ClientOptions options);                   // connects and says hello
  explicit Client(std::shared_ptr<Connection> connection);  // uses a given connection, for tests
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;
  ~Client();

  const wire::Welcome& welcome() const;
  void set_reply_deadline(std::chrono::milliseconds deadline);  // of all later calls, those of sessions included
  // Opens a session of a scene: TOML text, which the server reads. `scene_file` names the text in messages. A scene at
  // fault throws kInvalidScene with a line "scene_file:line:column: ..." for each fault.
  Session open(std::string scene, std::string scene_file, std::span<const std::uint64_t> node_ids,
               const OpenOptions& options = {});
  // Continues the session of a client that has ended. A session has one client at a time. Throws Error{kResumeRefused}
  // that names the nodes if those of the session are not as expected: the session stays as it is and can be resumed.
  Session resume(const Session::Ticket& ticket, const ExpectedNodes& expected = {});
  wire::ServerStatus server_status();

  // Calls for operators. top_nodes() answers with `inspected` and the columns of at most `count` nodes, highest value
  // first: by the interface temperature for Top::kHottest and Top::kMolten, for Top::kFastest by the magnitude of the
  // sliding velocity in the reply to the session's last step.
  wire::Checkpointed checkpoint();
  // within_s: with `exit` the server ends after this time even if sessions are open; 0: no such time.
  wire::Draining drain(bool exit, std::uint64_t within_s = 0);
  std::vector<wire::SessionInfo> sessions();
  Received top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count);
  // Ends a session whose client has ended, given as returned by sessions(), and frees its states. The server refuses
  // the call if the session has continued since.
  wire::SessionClosed close(const wire::SessionInfo& session);

 private:
  template <typename Answer, typename Question>
  Answer ask(Question question);

  std::shared_ptr<Connection> connection_;
  wire::Welcome welcome_;
};

}  // namespace shearbus
