// Tests of client and server over real sockets. The answers must have the same bits for every transport, every number
// of threads and every message size.
#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "server/embedded.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus {
namespace {

std::uint64_t bits(double value) {
  return std::bit_cast<std::uint64_t>(value);
}

using support::RunningServer;
using wire::Strategy;

std::vector<std::byte> bits_of(const StepResult& result) {
  std::vector<std::byte> bits;
  const auto append = [&](const auto& column) {
    const auto bytes = std::as_bytes(column);
    bits.insert(bits.end(), bytes.begin(), bytes.end());
  };
  append(result.shear_stress_pa());
  append(result.sliding_velocity_m_per_s());
  append(result.interface_temperature_k());
  append(result.velocity_jump_new_m_per_s());
  append(result.friction_heat_j_per_m2());
  append(result.regime());
  append(result.outcome());
  return bits;
}

std::vector<std::byte> ten_steps(Client& client, Strategy strategy, std::size_t nodes) {
  const auto ids = support::node_ids(nodes);
  Session session = client.open(support::text_of(support::scene_of(strategy)), "scene", ids);
  std::vector<std::byte> bits;
  for (int step = 0; step < 10; ++step) {
    const auto more = bits_of(session.advance(support::step_columns(strategy, ids, step), {.dt_s = 1e-9}));
    EXPECT_GE(more.size(), nodes * 34);
    bits.insert(bits.end(), more.begin(), more.end());
  }
  EXPECT_EQ(session.close().node_steps, 10 * nodes);
  return bits;
}

class RoundTrip : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, RoundTrip, support::both<Strategy>(), support::name_of_strategy);

TEST_P(RoundTrip, SameBitsByEveryTransportAndThreadCount) {
  // node counts with replies below and above the size from which ZeroMQ aligns frames
  for (const std::size_t nodes : {10u, 300u}) {
    std::vector<std::byte> expected;
    for (const unsigned threads : {1u, 2u, 4u}) {
      server::ServerOptions options;
      options.threads = threads;
      options.nodes_per_task = 64;
      RunningServer server(options);
      for (const char* scheme : {"inproc", "ipc", "tcp"}) {
        Client client = server.client(scheme);
        const auto bits = ten_steps(client, GetParam(), nodes);
        if (expected.empty()) expected = bits;
        ASSERT_TRUE(bits == expected) << scheme << ", " << threads << " threads, " << nodes << " nodes";
      }
    }
    server::Embedded embedded;
    Client client({.endpoint = embedded.endpoint(), .context = embedded.context()});
    ASSERT_TRUE(ten_steps(client, GetParam(), nodes) == expected) << "embedded";
  }
}

TEST_P(RoundTrip, PermutedAndSplitBatchesGiveEachNodeTheSameBits) {
  RunningServer server;
  Client client = server.client();
  const auto ids = support::node_ids(23);
  Session whole = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  Session parts = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  const std::vector<std::uint64_t> odd = {121, 101, 103, 119, 105, 107, 109, 117, 111, 113, 115};
  const std::vector<std::uint64_t> even = {100, 122, 102, 104, 106, 120, 108, 110, 112, 118, 114, 116};
  for (int step = 0; step < 8; ++step) {
    const auto& expected = whole.advance(support::step_columns(GetParam(), ids, step), {.dt_s = 1e-9});
    for (const auto& some : {odd, even}) {
      const auto& answer = parts.advance(support::step_columns(GetParam(), some, step, true), {.dt_s = 1e-9});
      for (std::size_t row = 0; row < some.size(); ++row) {
        const std::size_t i = some[row] - ids[0];
        ASSERT_EQ(bits(answer.shear_stress_pa()[row]), bits(expected.shear_stress_pa()[i]));
        ASSERT_EQ(bits(answer.interface_temperature_k()[row]), bits(expected.interface_temperature_k()[i]));
        ASSERT_EQ(answer.regime()[row], expected.regime()[i]);
      }
    }
  }
}

TEST_P(RoundTrip, TrialRollbackTrialCommitIsAdvance) {
  RunningServer server;
  Client client = server.client("tcp");
  const auto ids = support::node_ids(10);
  Session direct = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  Session hesitant = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  for (int step = 0; step < 8; ++step) {
    const auto expected = bits_of(direct.advance(support::step_columns(GetParam(), ids, step), {.dt_s = 1e-9}));
    hesitant.trial(support::step_columns(GetParam(), ids, step + 40), {.dt_s = 2e-9});
    hesitant.rollback();
    ASSERT_EQ(bits_of(hesitant.trial(support::step_columns(GetParam(), ids, step), {.dt_s = 1e-9, .attempt = 1})),
              expected);
    EXPECT_EQ(hesitant.commit(), static_cast<std::uint64_t>(step + 1));
  }
}

TEST(ClientSession, RequestsHaveTheColumnsOfTheScene) {
  RunningServer server;
  Client client = server.client();
  const auto ids = support::node_ids(3);
  Session session = client.open(support::text_of(support::force_scene()), "scene", ids);
  EXPECT_EQ(session.node_ids, ids);
  EXPECT_GT(session.opened.bytes_per_node, 0u);
  // the server warns that an insulated layer of 20 um is valid for a limited time
  EXPECT_FALSE(session.opened.warnings.empty());
  const Batch all = session.request();
  EXPECT_EQ(all.columns().size(), 6u);
  EXPECT_EQ(all.f64(Field::kMassHard).size(), 3u);
  const Batch one = session.request_for(std::vector<std::uint64_t>{102});
  EXPECT_EQ(one.u64(Field::kNodeId)[0], 102u);
  session.wanted = {Field::kShearStress};
  const auto& result = session.advance(support::step_columns(Strategy::kForceDriven, ids, 0), {.dt_s = 1e-9});
  EXPECT_EQ(result.shear_stress_pa().size(), 3u);
  EXPECT_TRUE(result.interface_temperature_k().empty());
  EXPECT_GT(result.round_trip().count(), 0);
}

TEST(ClientSession, InitialTemperaturesReachTheirNodes) {
  RunningServer server;
  Client client = server.client();
  const auto ids = support::node_ids(4);
  const std::vector<double> temperatures = {300, 400, 500, 600};
  Session session =
      client.open(support::text_of(support::velocity_scene()), "scene", ids, {.initial_temperature_k = temperatures});
  // all inputs are 0: an open contact without slip, whose temperature does not change
  const Batch still = session.request();
  const auto result = session.advance(still, {.dt_s = 1e-9}).interface_temperature_k();
  for (std::size_t i = 0; i < ids.size(); ++i) EXPECT_NEAR(result[i], temperatures[i], 1e-9);
}

TEST(ClientErrors, TheServersRefusalArrivesWithFieldAndNodes) {
  RunningServer server;
  Client client = server.client();
  auto scene = support::velocity_scene();
  scene.mutable_soft()->set_material("aluminum_dlp");
  const auto ids = support::node_ids(4);
  const Status unknown = support::fault_of([&] { client.open(support::text_of(scene), "scene", ids); });
  EXPECT_EQ(unknown.code, Code::kInvalidScene);
  EXPECT_EQ(unknown.field, "soft.material");
  EXPECT_NE(unknown.text.find("aluminium_dlp"), std::string::npos) << "no suggestion: " << unknown.text;
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", ids);
  auto bad = support::step_columns(Strategy::kVelocityDriven, ids, 0);
  bad.f64(Field::kPressure)[2] = std::numeric_limits<double>::quiet_NaN();
  const Status not_a_number = support::fault_of([&] { session.advance(bad, {.dt_s = 1e-9}); });
  EXPECT_EQ(not_a_number.code, Code::kInvalidValue);
  EXPECT_EQ(not_a_number.field, "pressure_pa");
  EXPECT_EQ(not_a_number.node_ids, (std::vector<std::uint64_t>{102}));
  EXPECT_NO_THROW(session.advance(support::step_columns(Strategy::kVelocityDriven, ids, 0), {.dt_s = 1e-9}));
}

TEST(ClientErrors, NobodyThereIsSaidWithinTheDeadline) {
  const support::ScratchDirectory scratch;
  for (const std::string& endpoint : {scratch.ipc(), std::string("tcp://127.0.0.1:1")}) {
    const auto started = std::chrono::steady_clock::now();
    const Status fault = support::fault_of(
        [&] { Client client({.endpoint = endpoint, .connect_deadline = std::chrono::milliseconds(300)}); });
    EXPECT_EQ(fault.code, Code::kUnreachable);
    EXPECT_NE(fault.text.find(endpoint), std::string::npos);
    const auto took = std::chrono::steady_clock::now() - started;
    EXPECT_GE(took, std::chrono::milliseconds(300));
    EXPECT_LT(took, std::chrono::milliseconds(5000));
  }
}

TEST(ClientErrors, WhatIsNoEndpointIsRefusedAtOnce) {
  for (const char* endpoint : {"", "localhost:5555", "ws://localhost", "inproc://somewhere", "tcp://nonsense"})
    EXPECT_EQ(support::code_of([&] { Client({.endpoint = endpoint}); }), Code::kUnreachable) << endpoint;
}

}  // namespace
}  // namespace shearbus
