// Tests with faults and abuse over real sockets. After each fault the server must answer at once. The client of another
// session, which takes no part in the abuse, is a bystander: its states must have the same bits as on a server without
// abuse.
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/raw_peer.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/twin_session.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::RawDealer;
using support::RawStream;
using support::RunningServer;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(12);

wire::SessionId some_id(std::uint8_t number) {
  wire::SessionId id;
  id.fill(number);
  return id;
}

wire::Request opening(std::uint8_t session, std::span<const std::uint64_t> nodes = kNodes) {
  wire::Request request;
  request.request_id = 1;
  request.body = wire::OpenSession{.scene = support::text_of(support::force_scene()), .session_id = some_id(session)};
  request.batch = support::id_column(nodes);
  return request;
}

wire::Request step_request(std::uint8_t session, std::uint64_t sequence,
                           std::span<const std::uint64_t> nodes = kNodes) {
  wire::Request request;
  request.request_id = 100 + sequence;
  request.session_id = some_id(session);
  request.sequence = sequence;
  request.body = wire::Downscale{.dt_s = 1e-9};
  request.batch = support::step_columns(Strategy::kForceDriven, nodes, static_cast<int>(sequence));
  return request;
}

// Two servers with the same session of a bystander, a client that takes no part in the abuse: one server suffers the
// abuse, the other is undisturbed, for comparison.
class Faults : public testing::Test {
 protected:
  Faults() { bystander_.step(); }

  wire::ServerStatus status() {
    const auto started = std::chrono::steady_clock::now();
    const wire::ServerStatus status = bystander_.client().server_status();
    EXPECT_LT(std::chrono::steady_clock::now() - started, 4s);
    return status;
  }

  void TearDown() override {
    status();
    bystander_.steps(3);
    bystander_.expect_each_step_once(foreign_node_steps_);
  }

  RunningServer server_;
  support::TwinSession bystander_{server_.client_options(), Strategy::kForceDriven, kNodes};
  std::uint64_t foreign_node_steps_ = 0;  // node-steps that the test ran outside the session of the bystander
};

// For these small messages a parser would allocate much memory. The server must refuse them before it parses them, by
// their size and structure.
TEST_F(Faults, AmplifyingBodiesAreRefused) {
  RawDealer dealer(server_.endpoint());
  const std::string good = RawDealer::frames_of(opening(1))[0];
  std::string submessages = good;  // appends many empty fields 16 (hello), 3 bytes each
  for (int i = 0; i < 3'000'000; ++i) submessages += std::string("\x82\x01\x00", 3);
  std::string unknown = good;  // appends many unknown fields of number 1000, 3 bytes each
  for (int i = 0; i < 2'000'000; ++i) unknown += std::string("\xc0\x3e\x01", 3);
  for (const std::string& header : {submessages, unknown}) {
    dealer.send({header});
    EXPECT_EQ(dealer.receive_status()->code, Code::kLimit);
  }
  for (const std::string& header : {submessages.substr(0, 60'000), unknown.substr(0, 60'000)}) {
    dealer.send({header});
    EXPECT_EQ(dealer.receive_status()->code, Code::kMalformed);
  }
}

TEST_F(Faults, APeerThatSendsAFrameAboveTheLimitIsCutOff) {
  RawDealer large(server_.endpoint());
  large.send({std::string(wire::kMaxPayloadBytes + 1, 'x')});
  EXPECT_TRUE(large.receive(500ms).empty());
  RawDealer fits(server_.endpoint());
  fits.send({std::string(wire::kMaxPayloadBytes, 'x')});
  EXPECT_EQ(fits.receive_status()->code, Code::kLimit);
}

// The answer for a node has 42 bytes, so a few replies for 20,000 nodes fill the buffers of a connection.
TEST_F(Faults, APeerThatDoesNotReadHoldsNobodyUp) {
  const auto nodes = support::node_ids(20'000);
  RawDealer slow(server_.endpoint("tcp"), 1);
  slow.send(opening(1, nodes));
  ASSERT_TRUE(slow.receive_status()->ok());
  const auto request = RawDealer::frames_of(step_request(1, 1, nodes));
  for (int i = 0; i < 60; ++i) slow.send(request);  // the peer sends 60 requests and never reads a reply
  foreign_node_steps_ = nodes.size();
  std::chrono::nanoseconds slowest{0};
  for (int i = 0; i < 50; ++i) {
    const auto started = std::chrono::steady_clock::now();
    bystander_.step();
    slowest = std::max<std::chrono::nanoseconds>(slowest, std::chrono::steady_clock::now() - started);
  }
  EXPECT_LT(slowest, 5s);
  for (int i = 0; i < 100 && server_.transport().peer_full == 0; ++i) {
    std::this_thread::sleep_for(20ms);
    status();  // waits until the server is idle, so that its counters may be read
  }
  EXPECT_GT(server_.transport().peer_full, 0u);
  // The server still keeps the last reply: a peer that repeats the request on another connection, and reads, receives
  // the reply.
  RawDealer again(server_.endpoint());
  again.send(request);
  EXPECT_TRUE(again.receive_status()->ok());
}

TEST_F(Faults, StrayBytesNeverReachTheServer) {
  const std::uint64_t before = status().requests;
  for (const char* scheme : {"ipc", "tcp"})
    for (const std::string& stray : support::stray_bytes()) {
      RawStream stream(server_.endpoint(scheme));
      stream.send(stray);
      stream.closed_within(50ms);
    }
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(status().requests, before + 1);
}

TEST_F(Faults, DestroyedSessionsSayGoodbye) {
  { Session short_lived = bystander_.client().open(support::text_of(support::force_scene()), "scene", kNodes); }
  for (int i = 0; i < 100 && status().sessions != 1; ++i) std::this_thread::sleep_for(5ms);
  EXPECT_EQ(status().sessions, 1u);
  {
    Client other = server_.client("tcp");
    Session short_lived = other.open(support::text_of(support::force_scene()), "scene", kNodes);
  }
  for (int i = 0; i < 100 && status().sessions != 1; ++i) std::this_thread::sleep_for(5ms);
  EXPECT_EQ(status().sessions, 1u);
}

}  // namespace
}  // namespace shearbus
