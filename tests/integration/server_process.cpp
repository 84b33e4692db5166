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

// The client never finds its socket empty while it waits for an answer, as the answers are there when it asks.
TEST(ServerProgram, NoStepIsSentTwiceThatTheHostCollectsLate) {
  const ScratchDirectory scratch;
  ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc()});
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  for (int step = 0; step < 200; ++step) {
    const auto columns = support::step_columns(Strategy::kForceDriven, kNodes, step);
    session.start(columns, {.dt_s = 1e-9});
    std::this_thread::sleep_for(2ms);
    session.finish();
  }
  EXPECT_EQ(client.server_status().replayed, 0u);
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

}  // namespace
}  // namespace shearbus
