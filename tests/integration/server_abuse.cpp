// Tests of a server under floods of connections, without free file descriptors, and with frozen clients. Connected
// clients must still be served, and the server must recover.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <optional>
#include <thread>

#include "proto/files/key_file.hpp"
#include "shearbus_places.hpp"
#include "tests/support/raw_peer.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::RawStream;
using support::ScratchDirectory;
using support::ServerProcess;
using wire::Strategy;
using Clock = std::chrono::steady_clock;

const std::vector<std::uint64_t> kNodes = support::node_ids(8);

void step(Session& session, int number) {
  session.advance(support::step_columns(Strategy::kForceDriven, kNodes, number), {.dt_s = 1e-9});
}

// Returns the number of connections that the test opens without sending anything: as many as this machine allows a
// process, at most ten thousand.
std::size_t silent_connections() {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
  return std::min<std::size_t>(10'000, limit.rlim_cur - 200);
}

TEST(Abuse, TenThousandHalfOpenConnectionsDoNotKeepAnHonestClientWaiting) {
  for (const bool keys : {false, true}) {
    const std::size_t count = silent_connections();
    const ScratchDirectory scratch;
    const KeyPair server_keys = make_key_pair();
    const KeyPair client_keys = make_key_pair();
    files::write_secret_key(scratch / "secret", server_keys.secret_key);
    files::write_public_key(scratch / "list", {client_keys.public_key, ""});
    std::vector<std::string> arguments = {"--bind", scratch.ipc(), "--bind", "tcp://127.0.0.1:*"};
    if (keys)
      arguments.insert(arguments.end(), {"--curve-secret", scratch / "secret", "--authorized-keys", scratch / "list"});
    else
      arguments.emplace_back("--insecure-plaintext");
    ServerProcess server(arguments);
    ASSERT_TRUE(server.ready()) << server.log();
    const std::string tcp = server.tcp_endpoint();
    Client watcher({.endpoint = scratch.ipc()});
    Session session = watcher.open(support::text_of(support::force_scene()), "scene", kNodes);
    const std::uint64_t files_before = watcher.server_status().open_files;

    std::vector<RawStream> silent;
    silent.reserve(count);
    for (std::size_t i = 0; i < count; ++i) silent.emplace_back(tcp);
    const auto asked = Clock::now();
    ClientOptions honest{.endpoint = tcp};
    if (keys) {
      honest.server_key = server_keys.public_key;
      honest.secret_key = client_keys.secret_key;
    }
    EXPECT_NO_THROW(Client(honest).server_status());
    EXPECT_LT(Clock::now() - asked, 4s) << "keys: " << keys;
    EXPECT_NO_THROW(step(session, 0));
    // The server closes connections that send nothing after 5 s, the time limit of its handshake.
    std::uint64_t files = ~0ULL;
    for (const auto end = Clock::now() + 20s; files > files_before + 5 && Clock::now() < end;) {
      std::this_thread::sleep_for(200ms);
      files = watcher.server_status().open_files;
    }
    EXPECT_LE(files, files_before + 5) << "keys: " << keys;
    EXPECT_EQ(watcher.server_status().messages_without_user, 0u);
  }
}

// UBSan checks a virtual call by opening a pipe. Without free file descriptors this fails, and UBSan then reports every
// object as wrong, so this test does not run under sanitizers.
#if !defined(__SANITIZE_ADDRESS__)
TEST(Abuse, WhereNoFileIsLeftTheConnectedAreServedAndItPassesByItself) {
  const ScratchDirectory scratch;
  const std::string log = scratch / "log";
  const std::string start = "ulimit -n 128; exec " SHEARBUS_BINARY_DIR "/bin/shearbus-server --bind " + scratch.ipc() +
                            " --bind tcp://127.0.0.1:* --insecure-plaintext";
  support::Process server({"/bin/sh", "-c", start}, log);
  const auto logged = [&](const std::string& text, std::chrono::milliseconds time) {
    for (const auto end = Clock::now() + time; Clock::now() < end; std::this_thread::sleep_for(10ms))
      if (support::text_of(log).find(text) != std::string::npos) return true;
    return false;
  };
  ASSERT_TRUE(logged("listening on tcp://", 20s)) << support::text_of(log);
  const std::string text = support::text_of(log);
  const std::size_t at = text.find("tcp://127.0.0.1:", text.find("listening on tcp"));
  const std::string tcp = text.substr(at, text.find('\n', at) - at);
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  {
    std::vector<RawStream> silent;
    // the kernel accepts these connections, but the server has no file descriptor for them
    for (int i = 0; i < 150; ++i) silent.emplace_back(tcp);
    for (int i = 0; i < 20; ++i) EXPECT_NO_THROW(step(session, i));
    EXPECT_TRUE(logged("ALARM: four fifths of the files", 10s)) << support::text_of(log);
    EXPECT_NO_THROW(step(session, 20));
  }
  EXPECT_TRUE(logged("files can be opened again", 20s)) << support::text_of(log);
  EXPECT_NO_THROW(Client({.endpoint = tcp}).server_status());
  EXPECT_NO_THROW(step(session, 21));
  server.signal(SIGTERM);
  EXPECT_EQ(server.exit_code(10s), 0);
}
#endif

// libzmq aborts a process whose ipc listener finds no free file descriptor.
#if !defined(__SANITIZE_ADDRESS__)
TEST(Abuse, AFloodByIpcClosesItsOwnConnectionsAndEndsNoServer) {
  const ScratchDirectory scratch;
  const std::string log = scratch / "log";
  const std::string start = "ulimit -n 256; exec " SHEARBUS_BINARY_DIR "/bin/shearbus-server --bind " + scratch.ipc();
  support::Process server({"/bin/sh", "-c", start}, log);
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  std::vector<RawStream> silent;
  for (int i = 0; i < 400; ++i) silent.emplace_back(scratch.ipc());
  for (int i = 0; i < 20; ++i) EXPECT_NO_THROW(step(session, i));
  const wire::ServerStatus status = client.server_status();
  EXPECT_LT(status.open_files, 210u) << "a fifth of the 256 descriptors stays free for files";
  const auto logged = [&] { return support::text_of(log).find("REFUSED: ") != std::string::npos; };
  for (const auto end = Clock::now() + 5s; !logged() && Clock::now() < end;) std::this_thread::sleep_for(20ms);
  EXPECT_TRUE(logged()) << support::text_of(log);
  // The handshake's time limit closes the others, and then a new client is served.
  EXPECT_NO_THROW(Client({.endpoint = scratch.ipc(), .connect_deadline = 20s}).server_status());
  server.signal(SIGTERM);
  EXPECT_EQ(server.exit_code(10s), 0);
}
#endif

// The largest message is 32 MiB, and libzmq allows that before the handshake, too.
TEST(Abuse, PeersWithoutAKeyHoldNoMemory) {
  const ScratchDirectory scratch;
  const KeyPair server_keys = make_key_pair();
  const KeyPair client_keys = make_key_pair();
  files::write_secret_key(scratch / "secret", server_keys.secret_key);
  files::write_public_key(scratch / "list", {client_keys.public_key, ""});
  ServerProcess server({"--bind", scratch.ipc(), "--bind", "tcp://127.0.0.1:*", "--curve-secret", scratch / "secret",
                        "--authorized-keys", scratch / "list"});
  ASSERT_TRUE(server.ready()) << server.log();
  Client watcher({.endpoint = scratch.ipc()});
  const std::uint64_t before = watcher.server_status().resident_bytes;

  // ZMTP 3 with CURVE as its mechanism, then a command of 32 MB minus its last byte.
  std::string greeting(
      "\xff\0\0\0\0\0\0\0\x01\x7f\x03\x01"
      "CURVE",
      17);
  greeting.resize(64, '\0');
  const std::string long_command("\x06\0\0\0\0\x01\xf0\0\0", 9);
  const std::string megabyte(std::size_t{1} << 20, 'x');
  constexpr int kPeers = 16;
  std::vector<RawStream> peers;
  std::uint64_t largest = before;
  for (int i = 0; i < kPeers; ++i) {
    RawStream& peer = peers.emplace_back(server.tcp_endpoint());
    peer.send(greeting);
    peer.send(long_command);
    for (int sent = 0; sent < 30 && peer.send(megabyte); ++sent) {
    }
    largest = std::max(largest, watcher.server_status().resident_bytes);
  }
  RecordProperty("held_mib", std::to_string((largest - before) >> 20));
  EXPECT_LT(largest - before, std::uint64_t{64} << 20);
  ClientOptions honest{.endpoint = server.tcp_endpoint()};
  honest.server_key = server_keys.public_key;
  honest.secret_key = client_keys.secret_key;
  Client client(honest);
  const auto nodes = support::node_ids(20'000);  // its messages are larger than what a stranger may send
  Session session = client.open(support::text_of(support::force_scene()), "scene", nodes);
  EXPECT_NO_THROW(session.advance(support::step_columns(Strategy::kForceDriven, nodes, 0), {.dt_s = 1e-9}));
}

// A client process that stops for longer than the heartbeat allows is disconnected. When the process runs again, the
// client reconnects and continues.
TEST(Abuse, AFrozenClientGoesOnWhereItWasAndHoldsNobodyUp) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  constexpr int kSteps = 40;
  const pid_t frozen = ::fork();  // forks before this process has a ZeroMQ context of its own
  if (frozen == 0) {
    int done = 0;
    try {
      Client client({.endpoint = scratch.ipc(), .retry_after = 500ms});
      Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
      for (; done < kSteps; ++done) {
        step(session, done);
        std::this_thread::sleep_for(50ms);
      }
      if (session.last_sequence != kSteps) ::_exit(2);
    } catch (const std::exception&) {
      ::_exit(1);
    }
    ::_exit(0);
  }
  Client client({.endpoint = scratch.ipc()});
  while (client.server_status().node_steps < 5 * kNodes.size()) std::this_thread::sleep_for(2ms);
  ::kill(frozen, SIGSTOP);
  const std::uint64_t before = client.server_status().connections_admitted;
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  std::chrono::nanoseconds slowest{0};
  int number = 0;
  for (const auto end = Clock::now() + 9s; Clock::now() < end; std::this_thread::sleep_for(20ms)) {
    const auto started = Clock::now();
    step(session, number++);
    slowest = std::max<std::chrono::nanoseconds>(slowest, Clock::now() - started);
  }
  EXPECT_LT(slowest, 4s);
  ::kill(frozen, SIGCONT);
  int status = 0;
  ::waitpid(frozen, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  const wire::ServerStatus after = client.server_status();
  EXPECT_GT(after.connections_admitted, before) << "it was disconnected and came back";
  EXPECT_EQ(after.node_steps, (kSteps + static_cast<std::uint64_t>(number)) * kNodes.size()) << "each step ran once";
}

}  // namespace
}  // namespace shearbus
