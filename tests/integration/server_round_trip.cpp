// Tests of client and server over real sockets. The answers must have the same bits for every transport, every number
// of threads and every message size.
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "server/embedded.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus {
namespace {

using support::RunningServer;
using wire::Strategy;

std::vector<std::byte> ten_steps(Client& client, Strategy strategy, std::size_t nodes) {
  const auto ids = support::node_ids(nodes);
  Session session = client.open(support::text_of(support::scene_of(strategy)), "scene", ids);
  std::vector<std::byte> bits;
  for (int step = 0; step < 10; ++step) {
    const StepResult& result = session.advance(support::step_columns(strategy, ids, step), {.dt_s = 1e-9});
    const auto more = result.batch().bytes();
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
