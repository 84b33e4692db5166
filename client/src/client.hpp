// Internal to the client library: a client of a server, and the sessions that it opens. Hosts and programs use the classes
// of client/include/shearbus/client.hpp.
//
// Every call throws Error with the code of the server's refusal or one of a client; shearbus.h says what they mean, and
// what a repeated call does. The sessions of a durable server (welcome().durability) outlive the server: calls wait for
// the restarted server until their deadline and then continue. They throw kEpoch if it was restored with older states.
// A client and its sessions belong to one thread; different clients are independent.
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
