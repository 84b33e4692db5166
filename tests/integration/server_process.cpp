// Tests of the program shearbus-server: how it starts, refuses to start, and stops.
#include "tests/support/server_process.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <fstream>
#include <thread>

#include "shearbus_places.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::ScratchDirectory;
using support::ServerProcess;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(10);

TEST(ServerProgram, SigtermWhenIdleIsAPromptGoodExit) {
  const ScratchDirectory scratch;
  for (const int signal : {SIGTERM, SIGINT}) {
    ServerProcess server({"--bind", scratch.ipc(), "--bind", "tcp://127.0.0.1:*", "--insecure-plaintext"});
    ASSERT_TRUE(server.ready()) << server.log();
    server.process().signal(signal);
    EXPECT_EQ(server.process().exit_code(5s), 0) << server.log();
    EXPECT_NE(server.log().find("stopped"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(scratch.path() / "bus")) << "the socket's name was left behind";
  }
}

// When SIGTERM arrives, the server still answers the step that it is solving. Afterwards the client learns that the
// server has stopped.
TEST(ServerProgram, SigtermMidRunAnswersTheStepAndExitsWithZero) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  std::atomic<int> steps{0};
  std::atomic<bool> ended{false};
  Code code = Code::kOk;
  std::thread host([&] {
    Client client({.endpoint = scratch.ipc(), .reply_deadline = 1s, .retry_after = 400ms});
    const auto nodes = support::node_ids(500);
    Session session = client.open(support::text_of(support::velocity_scene()), "scene", nodes);
    try {
      for (;; ++steps) session.advance(support::step_columns(Strategy::kVelocityDriven, nodes, steps), {.dt_s = 1e-9});
    } catch (const Error& fault) {
      code = fault.status().code;
    }
    ended = true;
  });
  while (steps < 3 && !ended) std::this_thread::sleep_for(1ms);
  server.process().signal(SIGTERM);
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().exit_code(10s), 0) << server.log();
  host.join();
  EXPECT_TRUE(code == Code::kShuttingDown || code == Code::kUnreachable || code == Code::kUnknownOutcome) << name(code);
}

TEST(ServerProgram, AClientThatStopsReadingDoesNotHoldUpTheExit) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  ::pid_t frozen = ::fork();
  if (frozen == 0) {
    try {
      Client client({.endpoint = scratch.ipc()});
      const auto nodes = support::node_ids(2000);
      Session session = client.open(support::text_of(support::force_scene()), "scene", nodes);
      for (int step = 0;; ++step)
        session.advance(support::step_columns(Strategy::kForceDriven, nodes, step), {.dt_s = 1e-9});
    } catch (...) {
    }
    ::_exit(0);
  }
  {
    Client client({.endpoint = scratch.ipc()});
    while (client.server_status().node_steps < 20'000) std::this_thread::sleep_for(2ms);
  }
  ::kill(frozen, SIGSTOP);
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().exit_code(5s), 0) << server.log();
  ::kill(frozen, SIGKILL);
  ::waitpid(frozen, nullptr, 0);
}

TEST(ServerProgram, KilledClientLeavesItsSessionAndTheOthersAlone) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  ::pid_t victim = ::fork();  // forks before this process has a ZeroMQ context of its own
  if (victim == 0) {
    try {
      Client client({.endpoint = scratch.ipc()});
      Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
      for (int step = 0;; ++step)
        session.advance(support::step_columns(Strategy::kForceDriven, kNodes, step), {.dt_s = 1e-9});
    } catch (...) {
    }
    ::_exit(0);
  }
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  support::RunningServer quiet;
  Client quiet_client = quiet.client();
  Session twin = quiet_client.open(support::text_of(support::force_scene()), "scene", kNodes);
  for (int step = 0; step < 60; ++step) {
    if (step == 20) {
      while (client.server_status().sessions < 2) std::this_thread::sleep_for(1ms);
      ::kill(victim, SIGKILL);
      ::waitpid(victim, nullptr, 0);
    }
    const auto& a = session.advance(support::step_columns(Strategy::kForceDriven, kNodes, step), {.dt_s = 1e-9});
    const auto& b = twin.advance(support::step_columns(Strategy::kForceDriven, kNodes, step), {.dt_s = 1e-9});
    ASSERT_EQ(std::memcmp(a.shear_stress_pa().data(), b.shear_stress_pa().data(), kNodes.size() * sizeof(double)), 0)
        << step;
  }
  // The server keeps the sessions of both clients: the killed client and the other client have not closed them.
  EXPECT_EQ(client.server_status().sessions, 2u);
}

TEST(ServerProgram, ASecondServerOnThePathRefusesAndTheFirstGoesOn) {
  const ScratchDirectory scratch;
  ServerProcess first({"--bind", scratch.ipc()});
  ASSERT_TRUE(first.ready()) << first.log();
  Client client({.endpoint = scratch.ipc()});
  ServerProcess second({"--bind", scratch.ipc()});
  EXPECT_EQ(second.process().exit_code(5s), 1) << second.log();
  EXPECT_NE(second.log().find("another server listens on " + scratch.ipc()), std::string::npos) << second.log();
  EXPECT_NO_THROW(client.server_status());
  EXPECT_NO_THROW(Client({.endpoint = scratch.ipc()}));
  // The kernel releases the lock on the endpoint when the server process that holds it dies, even by SIGKILL.
  first.process().signal(SIGKILL);
  ASSERT_TRUE(first.process().exit_code(5s));
  ServerProcess third({"--bind", scratch.ipc()});
  EXPECT_TRUE(third.ready()) << third.log();
}

TEST(ServerProgram, ATakenPortIsRefused) {
  support::RunningServer first({}, {"tcp://127.0.0.1:*"});
  ServerProcess second({"--bind", first.endpoint("tcp"), "--insecure-plaintext"});
  EXPECT_EQ(second.process().exit_code(5s), 1);
  EXPECT_NE(second.log().find("cannot listen on " + first.endpoint("tcp")), std::string::npos) << second.log();
}

TEST(ServerProgram, WhatMustNotBeBoundIsRefusedWithAReason) {
  const ScratchDirectory scratch;
  std::ofstream(scratch.path() / "precious.txt") << "contents";
  const struct {
    std::string endpoint, reason;
    int code = 2;
  } cases[] = {{"tcp://0.0.0.0:5999", "--insecure-plaintext"},
               {"tcp://127.0.0.1:5999", "--curve-secret"},
               {"ws://127.0.0.1:5999", "scheme \"ws\""},
               {"/run/bus", "no scheme"},
               {"ipc://" + (scratch.path() / "none" / "none" / "bus").string(), "cannot be made", 1},
               {"ipc://" + (scratch.path() / "precious.txt").string(), "not a socket", 1},
               {"ipc://" + (scratch.path() / std::string(120, 'x')).string(), "has at most 107"}};
  for (const auto& c : cases) {
    ServerProcess server({"--bind", c.endpoint});
    EXPECT_EQ(server.process().exit_code(5s), c.code) << c.endpoint;
    EXPECT_NE(server.log().find(c.reason), std::string::npos) << server.log();
  }
  EXPECT_EQ(support::text_of(scratch.path() / "precious.txt"), "contents");
}

TEST(ServerProgram, WrongUsageExitsWithTwo) {
  const std::vector<std::vector<std::string>> wrong = {{},
                                                       {"--bind"},
                                                       {"--bind", "ipc:///tmp/x", "--threads", "-1"},
                                                       {"--bind", "ipc:///tmp/x", "--log-level", "loud"},
                                                       {"--bind", "ipc:///tmp/x", "--friction-law", "x"},
                                                       {"--bind", "ipc:///tmp/x", "--curve-secret", "none"},
                                                       {"--nonsense"}};
  for (const auto& arguments : wrong) {
    ServerProcess server(arguments);
    EXPECT_EQ(server.process().exit_code(5s), 2) << server.log();
  }
}

TEST(ServerProgram, TheSocketIsForItsOwnerOnly) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  const auto permissions = std::filesystem::status(scratch.path() / "bus").permissions();
  EXPECT_EQ(permissions & (std::filesystem::perms::group_all | std::filesystem::perms::others_all),
            std::filesystem::perms::none);
}

// The server may drop an answer only to a client that does not read. If it regarded the short queue to a reading client
// as full, it would drop an answer, and the client would wait until its retry.
TEST(ServerProgram, NoAnswerIsLostToAClientThatReads) {
  for (int round = 0; round < 5; ++round) {
    const ScratchDirectory scratch;
    ServerProcess server({"--bind", scratch.ipc()});
    ASSERT_TRUE(server.ready()) << server.log();
    Client client({.endpoint = scratch.ipc()});
    Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
    for (int step = 0; step < 200; ++step)
      session.advance(support::step_columns(Strategy::kForceDriven, kNodes, step), {.dt_s = 1e-9});
    EXPECT_EQ(client.server_status().replayed, 0u);
  }
}

TEST(ServerProgram, NothingIsLoggedPerStep) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  const auto lines = [&] { return std::ranges::count(server.log(), '\n'); };
  const auto before = lines();
  for (int step = 0; step < 50; ++step)
    session.advance(support::step_columns(Strategy::kForceDriven, kNodes, step), {.dt_s = 1e-9});
  EXPECT_EQ(lines(), before);
  session.close();
  EXPECT_EQ(lines(), before + 1);
}

TEST(ControlTool, PingAndStatusTellAServerFromNone) {
  const ScratchDirectory scratch;
  const std::string ctl = SHEARBUS_BINARY_DIR "/bin/shearbus-ctl";
  const std::string output = (scratch.path() / "output").string();
  const auto run = [&](std::vector<std::string> arguments) {
    std::filesystem::remove(output);
    arguments.insert(arguments.begin(), ctl);
    return support::Process(std::move(arguments), output).exit_code(20s);
  };
  EXPECT_EQ(run({"ping", "--server", scratch.ipc(), "--timeout", "0.3"}), 1);
  EXPECT_NE(support::text_of(output).find("shearbus-server --bind"), std::string::npos);
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  EXPECT_EQ(run({"ping", "--server", scratch.ipc()}), 0);
  EXPECT_EQ(run({"status", "--server", scratch.ipc()}), 0);
  EXPECT_NE(support::text_of(output).find("sessions     0"), std::string::npos) << support::text_of(output);
  EXPECT_EQ(run({"status", "--json", "--server", scratch.ipc()}), 0);
  EXPECT_EQ(support::text_of(output).front(), '{');
  EXPECT_EQ(run({"ping"}), 2);
  EXPECT_EQ(run({}), 2);
  EXPECT_EQ(run({"reference"}), 0);
  EXPECT_NE(support::text_of(output).find("yield_strength_pa"), std::string::npos);
}

TEST(ControlTool, CheckPointsIntoTheFile) {
  const ScratchDirectory scratch;
  const auto file = scratch.path() / "scene.toml";
  const std::string output = (scratch.path() / "output").string();
  const auto check = [&](const std::string& text) {
    std::ofstream(file) << text;
    std::filesystem::remove(output);
    return support::Process({SHEARBUS_BINARY_DIR "/bin/shearbus-ctl", "check", file.string()}, output).exit_code(20s);
  };
  const std::string head = "name = \"x\"\nstrategy = \"velocity_driven\"\n";
  EXPECT_EQ(check(head + "[soft]\nmaterial = \"aluminium_dlp\"\n[hard]\nmaterial = \"steel_dlp\"\n"), 0)
      << support::text_of(output);
  EXPECT_NE(support::text_of(output).find("melting_temperature_k"), std::string::npos);
  EXPECT_EQ(check(head + "[soft]\nmaterial = \"aluminum_dlp\"\n[hard]\nmaterial = \"steel_dlp\"\n"), 1);
  EXPECT_NE(support::text_of(output).find(file.string() + ":4:"), std::string::npos) << support::text_of(output);
  EXPECT_EQ(check(head + "[soft]\nmaterial = \"aluminium_dlp\"\n[hard]\nmaterial = \"steel_dlp\"\n[layer]\ncels = 3\n"),
            1);
  EXPECT_NE(support::text_of(output).find("did you mean"), std::string::npos) << support::text_of(output);
}

}  // namespace
}  // namespace shearbus
