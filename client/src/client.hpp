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
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/src/session.hpp"

namespace shearbus {

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
