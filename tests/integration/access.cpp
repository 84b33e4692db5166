// Access control over real sockets with real keys and users: which clients the server accepts and which it refuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <thread>

#include "proto/files/key_file.hpp"
#include "tests/support/raw_peer.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::RawDealer;
using support::RunningServer;
using support::ScratchDirectory;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(6);

// Collects log lines from several threads.
class Lines {
 public:
  server::Log log() {
    const auto keep = [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      text_ += line + "\n";
    };
    return {.info = keep, .debug = keep};
  }
  std::string text() const {
    const std::lock_guard lock(mutex_);
    return text_;
  }

 private:
  mutable std::mutex mutex_;
  std::string text_;
};

Status refusal_of(const ClientOptions& options) {
  return support::fault_of([&] { Client(options).server_status(); });
}

// Connects with a deadline of 60 s and returns the refusal, which must arrive long before. A client that does not
// monitor its socket would wait for the whole deadline.
Status prompt_refusal_of(ClientOptions options) {
  options.connect_deadline = 60s;
  const auto started = std::chrono::steady_clock::now();
  Status status = refusal_of(options);
  EXPECT_LT(std::chrono::steady_clock::now() - started, 10s) << describe(status);
  return status;
}

class Keys : public testing::Test {
 protected:
  Keys() {
    files::write_secret_key(scratch_ / "server.secret", server_keys_.secret_key);
    authorize("# clients\n" + alice_.public_key + " alice\n" + operator_.public_key + " operator olga\n");
  }
  void authorize(const std::string& text) const {
    std::ofstream(scratch_ / "new") << text;
    std::filesystem::rename(scratch_ / "new", scratch_ / "authorized");
  }
  server::ServerOptions options() const {
    server::ServerOptions options;
    options.curve_secret = scratch_ / "server.secret";
    options.authorized_keys = scratch_ / "authorized";
    return options;
  }
  ClientOptions client_options(const std::string& endpoint, const KeyPair& pair) const {
    return {.endpoint = endpoint, .server_key = server_keys_.public_key, .secret_key = pair.secret_key};
  }

  ScratchDirectory scratch_;
  KeyPair server_keys_ = make_key_pair();
  KeyPair alice_ = make_key_pair();
  KeyPair operator_ = make_key_pair();
  KeyPair mallory_ = make_key_pair();
};

TEST_F(Keys, WhoIsOnTheListIsServedWhoIsNotIsToldAtOnceAndNeverHeard) {
  for (const bool ipc_first : {true, false}) {
    const ScratchDirectory bus;
    const std::vector<std::string> endpoints = {ipc_first ? bus.ipc() : "tcp://127.0.0.1:*",
                                                ipc_first ? "tcp://127.0.0.1:*" : bus.ipc()};
    RunningServer server(options(), endpoints);
    const std::string& tcp = server.endpoint("tcp");
    Client alice(client_options(tcp, alice_));
    EXPECT_EQ(alice.welcome().access, "key");
    Client local = server.client("ipc");  // a client over ipc needs no key
    EXPECT_EQ(local.welcome().access, "uid");
    const std::uint64_t heard = alice.server_status().requests;

    const Status unknown = prompt_refusal_of(client_options(tcp, mallory_));
    EXPECT_EQ(unknown.code, Code::kAuth) << describe(unknown);
    EXPECT_THAT(unknown.remedy, HasSubstr(mallory_.public_key));
    const Status keyless = prompt_refusal_of({.endpoint = tcp});
    EXPECT_EQ(keyless.code, Code::kAuth) << describe(keyless);
    EXPECT_THAT(keyless.text, HasSubstr("expects clients with keys"));
    ClientOptions deceived = client_options(tcp, alice_);
    deceived.server_key = mallory_.public_key;
    const Status wrong_server = prompt_refusal_of(deceived);
    EXPECT_EQ(wrong_server.code, Code::kAuth) << describe(wrong_server);
    EXPECT_THAT(wrong_server.text, HasSubstr("server_key"));
    RawDealer plain(tcp);
    plain.send(std::vector<std::string>{"hello"});
    EXPECT_TRUE(plain.receive(200ms).empty());

    EXPECT_EQ(alice.server_status().requests, heard + 1);
    EXPECT_EQ(server.transport().without_user, 0u);
  }
}

TEST_F(Keys, StrayBytesNeverReachTheServer) {
  RunningServer server(options());
  const std::string& tcp = server.endpoint("tcp");
  Client alice(client_options(tcp, alice_));
  const std::uint64_t heard = alice.server_status().requests;
  std::vector<std::string> strays = support::stray_bytes();
  strays.push_back(std::string("\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f\x03\x00"
                               "CURVE",
                               17) +
                   std::string(47, '\0') + std::string("\x04\xc8\x05HELLO", 8) + std::string(194, 'x'));
  for (const std::string& stray : strays) {
    support::RawStream stream(tcp);
    stream.send(stray);
    stream.closed_within(50ms);
  }
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(alice.server_status().requests, heard + 1);
}

TEST_F(Keys, KeysAndPlaintextDoNotMeet) {
  RunningServer plain({}, {"tcp://127.0.0.1:*"});
  const Status status = prompt_refusal_of(client_options(plain.endpoint("tcp"), alice_));
  EXPECT_EQ(status.code, Code::kAuth) << describe(status);
  // Client and server both close the connection. The client's message depends on which is first, and that is chance.
  EXPECT_THAT(status.text, AnyOf(HasSubstr("the server has no keys"), HasSubstr("or no keys")));
  EXPECT_EQ(Client({.endpoint = plain.endpoint("tcp")}).welcome().access, "anonymous");
  EXPECT_EQ(refusal_of(client_options("ipc:///tmp/bus", alice_)).code, Code::kAuth);
  EXPECT_EQ(refusal_of({.endpoint = "tcp://127.0.0.1:1", .server_key = alice_.public_key}).code, Code::kAuth);
}

TEST_F(Keys, TheListIsReadAgainForEachConnectionAndAFaultyOneLetsNobodyIn) {
  Lines lines;
  RunningServer server(options(), {"tcp://127.0.0.1:*"}, lines.log());
  const std::string& tcp = server.endpoint("tcp");
  Client alice(client_options(tcp, alice_));
  EXPECT_EQ(refusal_of(client_options(tcp, mallory_)).code, Code::kAuth);
  EXPECT_THAT(lines.text(), HasSubstr("REFUSED connection from 127.0.0.1: key " + mallory_.public_key));
  authorize(alice_.public_key + "\n" + mallory_.public_key + "\n");
  EXPECT_TRUE(refusal_of(client_options(tcp, mallory_)).ok());
  authorize(alice_.public_key + "\nnonsense\n");
  EXPECT_EQ(refusal_of(client_options(tcp, alice_)).code, Code::kAuth);
  EXPECT_THAT(lines.text(), HasSubstr("line 2: expected a key"));
  EXPECT_NO_THROW(alice.server_status()) << "who is in stays";
  std::filesystem::remove(scratch_ / "authorized");
  EXPECT_EQ(refusal_of(client_options(tcp, alice_)).code, Code::kAuth);
  authorize(alice_.public_key + "\n");
  EXPECT_TRUE(refusal_of(client_options(tcp, alice_)).ok());
  EXPECT_EQ(refusal_of(client_options(tcp, mallory_)).code, Code::kAuth) << "taken off the list";
  ::chmod((scratch_ / "authorized").c_str(), 0666);
  EXPECT_EQ(refusal_of(client_options(tcp, alice_)).code, Code::kAuth) << "others could have written it";
}

TEST_F(Keys, AStolenTicketIsOfNoUseWithAnotherKey) {
  authorize(alice_.public_key + "\n" + mallory_.public_key + "\n" + operator_.public_key + " operator\n");
  Lines lines;
  RunningServer server(options(), {"tcp://127.0.0.1:*"}, lines.log());
  const std::string& tcp = server.endpoint("tcp");
  Client alice(client_options(tcp, alice_));
  Session session = alice.open(support::text_of(support::force_scene()), "scene", kNodes);
  const auto request = support::step_columns(Strategy::kForceDriven, kNodes, 0);
  session.advance(request, {.dt_s = 1e-9});
  Client mallory(client_options(tcp, mallory_));
  EXPECT_EQ(support::code_of([&] { mallory.resume(session.ticket()); }), Code::kNotPermitted);
  EXPECT_THAT(lines.text(), HasSubstr("REFUSED: key " + mallory_.public_key + " asked for session"));
  EXPECT_NO_THROW(session.advance(request, {.dt_s = 1e-9}));
  const Session::Ticket ticket = session.ticket();
  session.leave();
  Client olga(client_options(tcp, operator_));
  EXPECT_EQ(olga.resume(ticket).last_sequence, 2u);
}

TEST_F(Keys, OneUserCannotTakeWhatOthersNeed) {
  authorize(alice_.public_key + "\n" + mallory_.public_key + "\n" + operator_.public_key + " operator\n");
  server::ServerOptions limited = options();
  limited.sessions_per_user = 3;
  RunningServer server(limited, {"tcp://127.0.0.1:*"});
  const std::string& tcp = server.endpoint("tcp");
  Client mallory(client_options(tcp, mallory_));
  EXPECT_EQ(mallory.welcome().limits.max_sessions_per_user, 3u);
  std::vector<Session> taken;
  try {
    for (;;) taken.push_back(mallory.open(support::text_of(support::force_scene()), "scene", kNodes));
  } catch (const Error& fault) {
    EXPECT_EQ(fault.status().code, Code::kLimit);
    EXPECT_THAT(fault.what(), HasSubstr("--sessions-per-user"));
  }
  EXPECT_EQ(taken.size(), 3u);
  Client alice(client_options(tcp, alice_));
  Session session = alice.open(support::text_of(support::force_scene()), "scene", kNodes);
  EXPECT_EQ(alice.server_status().sessions, 1u) << "she sees her own";
  EXPECT_EQ(Client(client_options(tcp, operator_)).server_status().sessions, 4u);
}

TEST_F(Keys, OptionsThatDoNotGoTogetherAreRefusedWithTheReason) {
  files::write_public_key(scratch_ / "loose.secret", {server_keys_.secret_key, ""});
  const std::string secret = scratch_ / "server.secret";
  const std::string list = scratch_ / "authorized";
  const std::string foreign = scratch_ / "foreign";
  std::filesystem::copy_file(list, foreign);
  // Only root can give a file away; for others the list stays their own, and they are refused for its mode.
  const bool given = ::chown(foreign.c_str(), 65534, 65534) == 0;
  if (!given) ::chmod(foreign.c_str(), 0666);
  const struct {
    std::vector<std::string> arguments;
    std::string reason;
    int code = 2;
  } cases[] = {
      {{}, "--curve-secret and --authorized-keys"},
      {{"--curve-secret", secret, "--authorized-keys", foreign},
       given ? "belongs to uid 65534" : "others can write",
       1},
      {{"--curve-secret", secret}, "go together"},
      {{"--authorized-keys", list}, "go together"},
      {{"--curve-secret", secret, "--authorized-keys", list, "--insecure-plaintext"}, "without effect"},
      {{"--curve-secret", scratch_ / "loose.secret", "--authorized-keys", list}, "expected 0600", 1},
      {{"--curve-secret", secret, "--authorized-keys", scratch_ / "none"}, "No such file", 1},
  };
  for (const auto& c : cases) {
    std::vector<std::string> arguments = {"--bind", "tcp://127.0.0.1:*"};
    arguments.insert(arguments.end(), c.arguments.begin(), c.arguments.end());
    support::ServerProcess server(arguments);
    EXPECT_EQ(server.process().exit_code(10s), c.code) << c.reason;
    EXPECT_THAT(server.log(), HasSubstr(c.reason));
  }
}

// Runs `act` in a child process as the user `uid`. Returns the exit code of the child: 0 if the server accepted the
// user, 1 if it refused the user with the code AUTH, another number otherwise.
int as_user(uid_t uid, const std::function<void()>& act) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (::setgid(uid) != 0 || ::setuid(uid) != 0) ::_exit(3);
    try {
      act();
    } catch (const Error& fault) {
      ::_exit(fault.status().code == Code::kAuth ? 1 : 2);
    } catch (...) {
      ::_exit(2);
    }
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WEXITSTATUS(status);
}

TEST(Users, AnotherUserIsServedWhereTheListNamesHimAndHasSessionsOfHisOwn) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can be another user";
  constexpr uid_t kFriend = 65533;
  constexpr uid_t kStranger = 65534;
  const ScratchDirectory bus;
  ASSERT_EQ(::chmod(bus.path().c_str(), 0711), 0);
  support::ServerProcess server({"--bind", bus.ipc(), "--allow-uid", std::to_string(kFriend)});
  ASSERT_TRUE(server.ready()) << server.log();
  Session::Ticket ticket;
  const int shared = ::memfd_create("ticket", 0);
  EXPECT_EQ(as_user(kFriend,
                    [&] {
                      Client client({.endpoint = bus.ipc()});
                      Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
                      ticket = session.ticket();
                      if (::write(shared, &ticket, sizeof ticket) != sizeof ticket) ::_exit(4);
                      session.leave();
                    }),
            0);
  EXPECT_EQ(as_user(kStranger, [&] { Client({.endpoint = bus.ipc()}).server_status(); }), 1);
  ASSERT_EQ(::pread(shared, &ticket, sizeof ticket, 0), static_cast<ssize_t>(sizeof ticket));
  ::close(shared);
  Client root({.endpoint = bus.ipc()});
  EXPECT_NO_THROW(root.resume(ticket)) << "the server's own user is an operator";
  EXPECT_THAT(server.log(), HasSubstr("opened by uid 65533"));
  // The kernel keeps others away from the socket: they cannot even open a connection.
  EXPECT_EQ(as_user(kStranger,
                    [&] {
                      try {
                        const support::RawStream stream(bus.ipc());
                      } catch (const std::runtime_error&) {
                        ::_exit(errno == EACCES ? 0 : 5);
                      }
                      ::_exit(6);
                    }),
            0);
  // Where it does not, since the file system has no access lists, the server refuses them, and they are told at once.
  ASSERT_EQ(::chmod(bus.ipc().substr(std::strlen("ipc://")).c_str(), 0666), 0);
  EXPECT_EQ(
      as_user(kStranger,
              [&] {
                const Status status = prompt_refusal_of({.endpoint = bus.ipc()});
                const bool told = status.remedy.find("--allow-uid 65534") != std::string::npos;
                ::_exit(status.code == Code::kAuth && status.text.find("does not admit") != std::string::npos && told
                            ? 0
                            : 7);
              }),
      0);
}

TEST(Users, ADirectoryOthersCanEnterIsNoPlaceForASocket) {
  const ScratchDirectory scratch;
  ASSERT_EQ(::chmod(scratch.path().c_str(), 0755), 0);
  support::ServerProcess server({"--bind", scratch.ipc()});
  EXPECT_EQ(server.process().exit_code(10s), 1);
  EXPECT_THAT(server.log(), HasSubstr("expected 0700"));
  support::ServerProcess another({"--bind", "ipc://" + (scratch / "made" / "bus").string()});
  EXPECT_TRUE(another.ready()) << another.log();
}

}  // namespace
}  // namespace shearbus
