// The C++ client of the shearbus subgrid service.
//
//   shearbus::Client client({.endpoint = "ipc:///run/user/1000/shearbus/bus"});
//   shearbus::Session session = client.open(scene_text, "scene.toml", node_ids);
//   auto request = session.request();                       // columns of the scene's strategy, to be filled in
//   std::ranges::copy(jumps, request.f64(Field::kVelocityJump).begin());
//   const shearbus::StepResult& result = session.advance(request, {.dt_s = 1e-9});
//   result.shear_stress_pa(); ...
//
// Every call has a deadline and throws shearbus::Error on failure: what the server refused (its code and text),
// kUnreachable, kAuth (the server does not let this client in), kUnknownOutcome (no reply in time after retries: the
// step may or may not have run) or kUnexpectedReply. After kUnknownOutcome the same call with the same values is the
// same request: if it has run, it is not run again, and its reply comes. A different call is refused with
// kSequenceReused if the lost one has run; the session then goes on from there.
//
// Where the server is durable (welcome().durability), a session outlives it: calls wait for the server that comes back,
// until their deadline, and go on as if nothing had happened. Where it comes back with older states, they throw kEpoch.
// A client and its sessions belong to one thread; different clients are independent. SI units.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {

using wire::Batch;
using wire::Code;
using wire::Error;
using wire::Field;
using wire::Policy;
using wire::Status;
using wire::TransferId;

struct ClientOptions {
  std::string endpoint;                               // tcp://host:port, ipc://path or inproc://name
  void* context = nullptr;                            // libzmq context to share; required for inproc, else null
  std::string server_key;                             // tcp: the server's public CURVE key; empty: no encryption
  std::string secret_key;                             // this client's, with server_key; shearbus-ctl keygen makes both
  std::string name = "shearbus-client";               // what the server's log calls this client
  std::chrono::milliseconds connect_deadline{5'000};  // for the first hello
  std::chrono::milliseconds reply_deadline{60'000};   // for any other call, retries included
  std::chrono::milliseconds retry_after{5'000};       // no reply for so long: the same request again on a fresh socket
};

// CURVE keys, new; each 40 characters.
struct KeyPair {
  std::string public_key;
  std::string secret_key;
};
KeyPair make_key_pair();

struct OpenOptions {
  std::span<const double> initial_temperature_k;  // one per node; empty: the scene's
  // Node ids are unique over the sessions of a domain, such as the ranks of one run, and nodes can move between them;
  // only there may a session be opened without nodes. Empty: the session is alone.
  std::string domain;
};

struct StepOptions {
  double dt_s = 0.0;
  double time_s = 0.0;     // end of the step, for records only
  std::uint64_t step = 0;  // the host's number, for records only
  std::uint32_t attempt = 0;
  bool commit_previous = false;  // trial(): accept the standing trial first
  // What becomes of a step in which a node has no answer: by default it keeps its state and says so in its row.
  // kAllOrNothing: the call throws kStepFailed, which names the nodes, and nothing was changed.
  Policy policy = Policy::kAccept;
};

// The reply to a step; columns have one value per node, in the order of the request. Valid until the session's next
// call. Vectors have a component 1 where the scene has tangential_components = 2, and so have the request's columns.
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
  const Batch& batch() const { return reply_.batch; }  // all columns, others that were wanted among them
  std::span<const std::uint8_t> regime() const { return reply_.batch.u8(Field::kRegime); }
  std::span<const std::uint8_t> outcome() const { return reply_.batch.u8(Field::kOutcome); }
  const wire::Upscale& upscale() const { return std::get<wire::Upscale>(reply_.body); }
  std::chrono::nanoseconds round_trip() const { return round_trip_; }

 private:
  friend class Session;
  std::shared_ptr<void> payload_frame_;  // the received frame, kept while columns point into it
  wire::Reply reply_;
  std::chrono::nanoseconds round_trip_{0};
};

class Connection;  // socket, deadlines, retries

class Session {
 public:
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;
  ~Session();  // of a session that was not closed: says goodbye without waiting

  // Columns for all nodes, in the order of node_ids(), zeroed; optional columns of the strategy only when asked for.
  Batch request(std::span<const Field> optional_columns = {}) const;
  // The same for some nodes: rows in the order of `node_ids`.
  Batch request_for(std::span<const std::uint64_t> node_ids, std::span<const Field> optional_columns = {}) const;

  const StepResult& advance(const Batch& request, const StepOptions& step);  // step and accept
  const StepResult& trial(const Batch& request, const StepOptions& step);    // step; commit() or rollback() decides
  // trial() in two halves, for a host that has other work while the layers are computed: start_trial() sends the
  // request and returns, finish_trial() waits for the reply with the deadline and the retries of any call. In between
  // `request` stays as it is and the session makes no other call. Where finish_trial() throws, trial() with the same
  // values is the same request.
  void start_trial(const Batch& request, const StepOptions& step);
  const StepResult& finish_trial();
  std::uint64_t commit();
  std::uint64_t rollback();
  // Keeps the committed states on the server under a name, such as that of the host's own restart dump; the server
  // keeps the newest few (welcome().limits.max_marks). Going back to one makes its nodes and their states the session's
  // again, and drops a trial.
  wire::Marked mark(const std::string& name);
  std::uint64_t rollback_to(const std::string& mark);
  // The set of nodes; not while a trial stands. New nodes follow those there are, which keep their order: node_ids().
  void register_nodes(std::span<const std::uint64_t> node_ids,
                      std::span<const double> initial_temperature_k = {});  // one per node; empty: the scene's
  void retire_nodes(std::span<const std::uint64_t> node_ids);               // their states are freed
  // Hands nodes with their states to another session of the domain, which accepts them with what is returned here. In
  // between the server keeps them; the giver may take them back by accepting them itself.
  TransferId offer_nodes(std::span<const std::uint64_t> node_ids);
  std::vector<std::uint64_t> accept_nodes(const TransferId& transfer);
  wire::SessionClosed close();

  void want(std::vector<Field> columns);  // of the replies from now on; empty: all of the strategy's
  void want_energy_ledger();  // wire::kLedgerColumns beside all of the strategy's, where the scene has a ledger
  const std::string& effective_scene()
      const;  // canonical TOML text with every default and constant, as the server understood it
  const wire::SessionOpened& opened() const;  // the same, with the strategy and the columns of this session's steps
  const std::vector<std::string>& warnings() const;
  std::uint64_t bytes_per_node() const;
  const std::vector<std::uint64_t>& node_ids() const;  // in the order of the rows

  // What another process needs to go on with this session when this one is gone. Whoever holds it has the session.
  struct Ticket {
    wire::SessionId session_id{};
    wire::ResumeToken resume_token{};
  };
  Ticket ticket() const;
  // Of the offers that waited when the session was resumed: what a client that has gone had not handed on.
  const std::vector<TransferId>& offers() const;
  std::uint64_t last_sequence() const;  // of the last request that was answered; the opening is 0
  void leave();                         // ends without a goodbye: the server keeps the session for who resumes it

 private:
  friend class Client;
  struct Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Of the committed states; sliding_velocity_m_per_s by sliding velocity only.
struct TopNodes {
  wire::SessionInfo session;
  std::uint64_t matching = 0;  // of the session's nodes
  std::vector<std::uint64_t> node_ids;
  std::vector<double> interface_temperature_k;
  std::vector<double> shear_stress_pa;
  std::vector<double> sliding_velocity_m_per_s;
  std::vector<std::uint8_t> regime;
};

class Client {
 public:
  explicit Client(ClientOptions options);                   // connects and says hello
  explicit Client(std::shared_ptr<Connection> connection);  // over a connection of the caller's own, as tests do
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;
  ~Client();

  const wire::Welcome& welcome() const;
  // Opens a session of a scene: TOML text, which the server reads. `scene_file` names it in messages; a scene at fault throws kInvalidScene
  // with a line "scene_file:line:column: ..." for each fault.
  Session open(std::string scene, std::string scene_file, std::span<const std::uint64_t> node_ids,
               const OpenOptions& options = {});
  // The session of a client that has gone, where it was left. One client at a time: the first must be gone.
  Session resume(const Session::Ticket& ticket);
  wire::ServerStatus server_status();

  // An operator's. top_nodes: at most `count` nodes of a session, the top one first.
  wire::Checkpointed checkpoint();
  wire::Draining drain(bool exit);
  std::vector<wire::SessionInfo> sessions();
  TopNodes top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count);
  // Ends a session whose client is gone for good, as sessions() showed it: refused where it has gone on since. Its
  // states are lost.
  wire::SessionClosed close(const wire::SessionInfo& session);

 private:
  template <typename Answer, typename Question>
  Answer ask(Question question);

  std::shared_ptr<Connection> connection_;
  wire::Welcome welcome_;
};

}  // namespace shearbus
