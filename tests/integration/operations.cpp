// Tests for operators: shearbus-ctl against a running server, and a server under a service manager.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <thread>

#include "shearbus_places.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::ScratchDirectory;
using support::ServerProcess;
using ::testing::HasSubstr;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(15);

class Ctl {
 public:
  explicit Ctl(std::string endpoint) : endpoint_(std::move(endpoint)) {}
  // Runs shearbus-ctl with `words` as arguments. Returns its exit code and its output.
  std::pair<int, std::string> operator()(std::vector<std::string> words) const {
    words.insert(words.end(), {"--server", endpoint_});
    return plain(std::move(words));
  }
  std::pair<int, std::string> plain(std::vector<std::string> words) const {
    const std::string output = scratch_ / "output";
    std::filesystem::remove(output);
    words.insert(words.begin(), SHEARBUS_BINARY_DIR "/bin/shearbus-ctl");
    const auto code = support::Process(std::move(words), output).exit_code(30s);
    return {code.value_or(-1), support::text_of(output)};
  }

 private:
  std::string endpoint_;
  ScratchDirectory scratch_;
};

void step(Session& session, int number) {
  session.advance(support::step_columns(Strategy::kVelocityDriven, kNodes, number), {.dt_s = 1e-9});
}

TEST(Operations, AnOperatorSeesSessionsTopNodesAndMetricsWithoutStoppingTheRun) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc(), "--state-dir", scratch / "state", "--durability", "power"});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", kNodes);
  for (int i = 0; i < 20; ++i) step(session, i);
  const Ctl ctl(scratch.ipc());

  const auto [listed, sessions] = ctl({"sessions"});
  EXPECT_EQ(listed, 0) << sessions;
  EXPECT_THAT(sessions, HasSubstr("uid " + std::to_string(::geteuid())));
  EXPECT_THAT(ctl({"sessions", "--json"}).second, HasSubstr("\"last_sequence\":20"));
  for (const char* by : {"hottest", "fastest", "molten"}) {
    const auto [code, text] = ctl({"top", "--by", by, "--count", "3"});
    EXPECT_EQ(code, 0) << text;
    EXPECT_THAT(text, HasSubstr("15 nodes, version 20"));
  }
  EXPECT_EQ(ctl({"top", "nobody"}).first, 1);
  EXPECT_EQ(ctl({"top", "--by", "tallest"}).first, 2);

  const auto [written, report] = ctl({"checkpoint"});
  EXPECT_EQ(written, 0) << report;
  EXPECT_TRUE(std::filesystem::exists(scratch / "state" / "checkpoint-000000000001.h5"));
  step(session, 20);
  EXPECT_EQ(ctl({"checkpoint"}).first, 0);
  const std::string first = scratch / "state" / "checkpoint-000000000001.h5";
  const std::string second = scratch / "state" / "checkpoint-000000000002.h5";
  EXPECT_EQ(ctl.plain({"compare", first, first}), std::pair(0, std::string("the same states\n")));
  EXPECT_EQ(ctl.plain({"compare", first, second}).first, 1);
  EXPECT_THAT(ctl.plain({"compare", first, second}).second, HasSubstr("last request: 20 and 21"));
  EXPECT_EQ(ctl.plain({"compare", first, scratch / "absent"}).first, 2);

  const auto [told, metrics] = ctl({"metrics"});
  EXPECT_EQ(told, 0);
  // The metrics must follow the grammar of the Prometheus text format. In a histogram the values of successive buckets
  // must not decrease, and the last value must equal the count.
  const std::regex line(
      R"((# (HELP|TYPE) shearbus_[a-z_]+ .+)|(shearbus_[a-z_]+(\{([a-z]+="[^"]*",?)+\})? [0-9.e+-]+))");
  std::istringstream lines(metrics);
  double last = 0;
  for (std::string text; std::getline(lines, text);) {
    EXPECT_TRUE(std::regex_match(text, line)) << text;
    if (!text.starts_with("shearbus_request_seconds_bucket{verb=\"downscale\"")) continue;
    const double value = std::stod(text.substr(text.rfind(' ')));
    EXPECT_GE(value, last) << text;
    last = value;
  }
  EXPECT_EQ(last, 21);
  EXPECT_THAT(metrics, HasSubstr("shearbus_request_seconds_count{verb=\"downscale\"} 21\n"));
  EXPECT_THAT(metrics, HasSubstr("shearbus_journal_append_seconds_count 22\n"));
  // Each record is brought to the disk. Where the session was quiet for a second, there is one more, of its last reply.
  const auto value_of = [&text = metrics](const std::string& name) {
    const std::size_t at = text.find("\n" + name + " ");
    return at == std::string::npos ? -1.0 : std::stod(text.substr(at + name.size() + 2));
  };
  EXPECT_GE(value_of("shearbus_journal_records_total"), 22.0);
  EXPECT_EQ(value_of("shearbus_journal_sync_seconds_count"), value_of("shearbus_journal_records_total"));
  EXPECT_THAT(metrics, HasSubstr("shearbus_checkpoint_seconds_count 2\n"));
  EXPECT_THAT(metrics, HasSubstr("shearbus_sessions 1\n"));
  EXPECT_THAT(metrics, HasSubstr("shearbus_admitting 1\n"));
  EXPECT_THAT(ctl({"status"}).second, HasSubstr("2 checkpoints (0 failed)"));
  EXPECT_NO_THROW(step(session, 21));
}

// If a host dies and its session ticket is lost, the session stays open. Only an operator can close the session to free
// its nodes, and only after the session has been idle for some time.
TEST(Operations, ASessionLeftBehindIsClosedOnlyAfterItsIdleTime) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc(), "--state-dir", scratch / "state"});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", kNodes);
  Session other = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  step(session, 0);
  const Ctl ctl(scratch.ipc());
  const std::string name = support::velocity_scene().name();
  const auto [early, refusal] = ctl({"close", name});
  EXPECT_EQ(early, 1);
  EXPECT_THAT(refusal, HasSubstr("only after 60 s without a request"));
  EXPECT_EQ(ctl({"close", "nobody", "--idle", "0"}).first, 1);
  step(session, 1);

  // The operator has listed the sessions; then the client makes a step. The server refuses to close the session as it
  // was listed, because the client is still active.
  const auto seen = client.sessions();
  const auto info = std::ranges::find(seen, name, &wire::SessionInfo::name);
  ASSERT_NE(info, seen.end());
  step(session, 2);
  EXPECT_THROW(client.close(*info), Error);
  step(session, 3);

  const auto [code, text] = ctl({"close", name, "--idle", "0"});
  EXPECT_EQ(code, 0) << text;
  EXPECT_THAT(text, HasSubstr("15 nodes, 5 requests"));
  EXPECT_THROW(step(session, 4), Error);
  EXPECT_THAT(ctl({"status"}).second, HasSubstr("1 with 15 nodes"));
  other.close();
}

// A ping must fail within a second if the server process is stopped by SIGSTOP, as it does if there is no server.
TEST(Operations, APingTellsWithinASecondThatNobodyAnswers) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  const Ctl ctl(scratch.ipc());
  EXPECT_EQ(ctl({"ping", "--timeout", "20"}).first, 0);
  server.process().signal(SIGSTOP);
  const auto started = std::chrono::steady_clock::now();
  EXPECT_EQ(ctl({"ping"}).first, 1);
  // 4 s: 1 s for the ping and some time to start the program. All other deadlines of the program are longer.
  EXPECT_LT(std::chrono::steady_clock::now() - started, 4s);
  server.process().signal(SIGCONT);
  EXPECT_EQ(ctl({"ping", "--timeout", "20"}).first, 0);
}

// Takes the place of systemd as the service manager: a datagram socket, whose path the server finds in its environment.
class Manager {
 public:
  explicit Manager(const std::string& watchdog_us) : file_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = scratch_ / "notify";
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    if (::bind(file_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      throw std::runtime_error("bind");
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
    if (!watchdog_us.empty()) ::setenv("WATCHDOG_USEC", watchdog_us.c_str(), 1);
  }
  ~Manager() {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::close(file_);
  }
  Manager(const Manager&) = delete;
  Manager& operator=(const Manager&) = delete;

  // Receives messages of the server for `time`, or until they contain the text `until`. Returns all messages received.
  std::string heard(std::chrono::milliseconds time, const std::string& until = "\1") {
    std::string all;
    const auto end = std::chrono::steady_clock::now() + time;
    while (std::chrono::steady_clock::now() < end && all.find(until) == std::string::npos) {
      char text[512];
      const ssize_t size = ::recv(file_, text, sizeof text, MSG_DONTWAIT);
      if (size > 0)
        all.append(text, static_cast<std::size_t>(size)).append("\n");
      else
        std::this_thread::sleep_for(5ms);
    }
    return all;
  }

 private:
  ScratchDirectory scratch_;
  int file_;
};

TEST(ServiceManager, IsToldReadyAliveAndStoppingByTheLoopThatCommits) {
  const ScratchDirectory scratch;
  Manager manager("30000000");
  ServerProcess server({"--bind", scratch.ipc(), "--state-dir", scratch / "state"});
  EXPECT_THAT(manager.heard(20s, "READY=1"), HasSubstr("READY=1\nSTATUS=listening on ipc://"));
  Client client({.endpoint = scratch.ipc()});  // succeeds only if the server listens
  EXPECT_THAT(manager.heard(5s, "WATCHDOG=1"), HasSubstr("WATCHDOG=1\n"));
  EXPECT_THAT(manager.heard(5s, "WATCHDOG=1"), HasSubstr("WATCHDOG=1\n"));
  server.process().signal(SIGSTOP);
  manager.heard(100ms);
  EXPECT_EQ(manager.heard(2500ms), "") << "nobody else feeds the watchdog";
  server.process().signal(SIGCONT);
  EXPECT_THAT(manager.heard(5s, "WATCHDOG=1"), HasSubstr("WATCHDOG=1\n"));

  Session session = client.open(support::text_of(support::velocity_scene()), "scene", kNodes);
  step(session, 0);
  client.checkpoint();
  const std::string during = manager.heard(5s, "WATCHDOG_USEC=30000000");
  EXPECT_THAT(during, HasSubstr("WATCHDOG_USEC=3600000000\n")) << "a checkpoint may take longer";
  step(session, 1);
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().exit_code(10s), 0) << server.log();
  const std::string end = manager.heard(500ms);
  EXPECT_THAT(end, HasSubstr("STOPPING=1\nEXTEND_TIMEOUT_USEC="));
}

TEST(ServiceManager, WithoutAWatchdogIsNotFed) {
  const ScratchDirectory scratch;
  Manager manager("");
  ServerProcess server({"--bind", scratch.ipc()});
  EXPECT_THAT(manager.heard(20s, "READY=1"), HasSubstr("READY=1"));
  EXPECT_EQ(manager.heard(2s), "");
}

TEST(ServiceManager, OneThatCannotBeReachedIsAnErrorAtTheStart) {
  const ScratchDirectory scratch;
  ::setenv("NOTIFY_SOCKET", (scratch / "nobody").c_str(), 1);
  ServerProcess server({"--bind", scratch.ipc()});
  ::unsetenv("NOTIFY_SOCKET");
  EXPECT_EQ(server.process().exit_code(10s), 1);
  EXPECT_THAT(server.log(), HasSubstr("NOTIFY_SOCKET"));
}

// systemd's own program, systemd-analyze, must find no fault in the unit file and must rate its isolation as good.
// Skipped if the program is not installed.
TEST(ServiceManager, TheUnitIsSoundAndShutIn) {
  if (!std::filesystem::exists("/usr/bin/systemd-analyze")) GTEST_SKIP() << "systemd-analyze is not installed";
  const ScratchDirectory scratch;
  std::string unit = support::text_of(SHEARBUS_SOURCE_DIR "/deploy/systemd/shearbus-server.service");
  // path in the unit file; the test replaces it by that of the build
  const std::string program = "/usr/bin/shearbus-server";
  unit.replace(unit.find(program), program.size(), SHEARBUS_BINARY_DIR "/bin/shearbus-server");
  const std::string file = scratch / "shearbus-server.service";
  std::ofstream(file) << unit;
  const std::string output = scratch / "output";
  EXPECT_EQ(support::Process({"/usr/bin/systemd-analyze", "verify", file}, output).exit_code(30s), 0)
      << support::text_of(output);
  EXPECT_EQ(support::text_of(output).find("Unknown"), std::string::npos) << support::text_of(output);
  EXPECT_EQ(support::Process({"/usr/bin/systemd-analyze", "security", "--offline=yes", "--threshold=20", file}, output)
                .exit_code(30s),
            0)
      << support::text_of(output);
}

}  // namespace
}  // namespace shearbus
