// Tests with faults and abuse over real sockets. After each fault the server must answer at once. The client of another
// session, which takes no part in the abuse, is a bystander: its states must have the same bits as on a server without
// abuse.
#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "server/embedded.hpp"
#include "tests/support/raw_peer.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

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

std::vector<std::string> frames_of_reply(RawDealer& dealer) {
  std::vector<std::string> frames;
  for (const zmq::message_t& frame : dealer.receive()) frames.push_back(frame.to_string());
  return frames;
}

// Two servers with the same session of a bystander, a client that takes no part in the abuse: one server suffers the
// abuse, the other is undisturbed, for comparison.
class Faults : public testing::Test {
 protected:
  Faults()
      : client_(server_.client()),
        quiet_client_({.endpoint = quiet_.endpoint(), .context = quiet_.context()}),
        bystander_(client_.open(support::text_of(support::force_scene()), "scene", kNodes)),
        twin_(quiet_client_.open(support::text_of(support::force_scene()), "scene", kNodes)) {
    step_both();
  }

  void step_both() {
    const auto request = support::step_columns(Strategy::kForceDriven, kNodes, steps_);
    ++steps_;
    const auto& a = bystander_.advance(request, {.dt_s = 1e-9});
    const auto& b = twin_.advance(request, {.dt_s = 1e-9});
    ASSERT_EQ(std::memcmp(a.shear_stress_pa().data(), b.shear_stress_pa().data(), kNodes.size() * sizeof(double)), 0);
    ASSERT_EQ(std::memcmp(a.interface_temperature_k().data(), b.interface_temperature_k().data(),
                          kNodes.size() * sizeof(double)),
              0);
    ASSERT_EQ(std::memcmp(a.velocity_jump_new_m_per_s().data(), b.velocity_jump_new_m_per_s().data(),
                          kNodes.size() * sizeof(double)),
              0);
  }

  wire::ServerStatus status() {
    const auto started = std::chrono::steady_clock::now();
    const wire::ServerStatus status = client_.server_status();
    EXPECT_LT(std::chrono::steady_clock::now() - started, 4s);
    return status;
  }

  void TearDown() override {
    status();
    for (int i = 0; i < 3; ++i) step_both();
    EXPECT_EQ(status().node_steps - foreign_node_steps_, static_cast<std::uint64_t>(steps_) * kNodes.size());
  }

  RunningServer server_;
  server::Embedded quiet_;
  Client client_;
  Client quiet_client_;
  Session bystander_;
  Session twin_;
  int steps_ = 0;
  std::uint64_t foreign_node_steps_ = 0;  // node-steps that the test ran outside the session of the bystander
};

TEST_F(Faults, RepeatedRequestIsAnsweredAgainAndRunOnce) {
  RawDealer dealer(server_.endpoint());
  dealer.send(opening(1));
  ASSERT_TRUE(dealer.receive_status()->ok());
  const auto request = RawDealer::frames_of(step_request(1, 1));
  dealer.send(request);
  const auto first = frames_of_reply(dealer);
  ASSERT_EQ(first.size(), 2u);
  // The same request is sent three more times, once on another connection. The payload of each reply must have the same
  // bytes as that of the first reply.
  RawDealer elsewhere(server_.endpoint());
  for (RawDealer* from : {&dealer, &elsewhere, &dealer}) {
    from->send(request);
    const auto again = frames_of_reply(*from);
    ASSERT_EQ(again.size(), 2u);
    EXPECT_EQ(again[1], first[1]);
    EXPECT_NE(again[0], first[0]);  // the header differs, because it marks the reply as a repetition
  }
  foreign_node_steps_ = kNodes.size();
  EXPECT_EQ(status().replayed, 3u);
}

TEST_F(Faults, ReusedStaleAndMissingSequencesAreRefused) {
  RawDealer dealer(server_.endpoint());
  dealer.send(opening(1));
  ASSERT_TRUE(dealer.receive_status()->ok());
  for (std::uint64_t sequence = 1; sequence <= 2; ++sequence) {
    dealer.send(step_request(1, sequence));
    ASSERT_TRUE(dealer.receive_status()->ok());
  }
  auto other = step_request(1, 2);
  other.batch.f64(Field::kPressure)[0] *= 2;
  dealer.send(other);
  EXPECT_EQ(dealer.receive_status()->code, Code::kSequenceReused);
  dealer.send(step_request(1, 1));
  EXPECT_EQ(dealer.receive_status()->code, Code::kStaleSequence);
  dealer.send(step_request(1, 4));
  const auto gap = dealer.receive_status();
  EXPECT_EQ(gap->code, Code::kSequenceGap);
  EXPECT_EQ(gap->last_sequence, 2u);
  foreign_node_steps_ = 2 * kNodes.size();
}

TEST_F(Faults, WrongNumbersOfFramesAreBadFraming) {
  RawDealer dealer(server_.endpoint());
  const auto good = RawDealer::frames_of(step_request(1, 1));
  for (const std::size_t count : {1u, 3u, 4u, 100u}) {
    std::vector<std::string> frames(count, good[1]);
    frames[0] = good[0];
    dealer.send(frames);
    const auto status = dealer.receive_status();
    ASSERT_TRUE(status.has_value()) << count;
    EXPECT_EQ(status->code, Code::kBadFraming) << count;
  }
}

TEST_F(Faults, GarbageIsMalformed) {
  RawDealer dealer(server_.endpoint());
  const auto good = RawDealer::frames_of(opening(1));
  const std::vector<std::vector<std::string>> bodies = {{""},
                                                        {"GET / HTTP/1.1\r\n\r\n"},
                                                        {std::string(1000, '\xff')},
                                                        {std::string(1000, '\0')},
                                                        {good[0].substr(0, good[0].size() / 2), good[1]},
                                                        {good[0] + good[0], good[1]},
                                                        {good[0] + "x", good[1]},
                                                        {"", good[0], good[1]}};
  for (const auto& body : bodies) {
    dealer.send(body);
    const auto status = dealer.receive_status();
    ASSERT_TRUE(status.has_value());
    EXPECT_LT(static_cast<int>(status->code), 200) << describe(*status);
  }
  EXPECT_EQ(status().sessions, 1u);
}

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

TEST_F(Faults, OtherMajorVersionsAreToldWhichOneIsSpoken) {
  RawDealer dealer(server_.endpoint());
  auto request = opening(1);
  request.protocol_major = 2;
  dealer.send(request);
  EXPECT_EQ(dealer.receive_status()->code, Code::kVersion);
}

TEST_F(Faults, UnknownAndDuplicateNodesAreRefused) {
  Session session = client_.open(support::text_of(support::force_scene()), "scene", kNodes);
  for (const auto& [ids, code] : {std::pair{std::vector<std::uint64_t>{100, 5}, Code::kUnknownNode},
                                  std::pair{std::vector<std::uint64_t>{100, 101, 100}, Code::kDuplicateNode}}) {
    const Batch request = support::step_columns(Strategy::kForceDriven, ids, 0, true);
    const Status fault = support::fault_of([&] { session.advance(request, {.dt_s = 1e-9}); });
    EXPECT_EQ(fault.code, code);
    EXPECT_EQ(fault.node_ids.size(), 1u);
  }
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
    step_both();
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
  const std::vector<std::string> strays = {
      "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
      std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11) + std::string(512, 'a'),   // a TLS client hello
      std::string("\x01\x00\x06\x00hello", 9),                                                   // ZMTP 1.0
      std::string("\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f\x01\x05\x00\x00\x00\x05hello", 21),  // ZMTP 2.0
      std::string(100'000, '\0'),
      std::string(100'000, '\xff'),
      "\r\n"};
  for (const char* scheme : {"ipc", "tcp"})
    for (const std::string& stray : strays) {
      RawStream stream(server_.endpoint(scheme));
      stream.send(stray);
      stream.closed_within(50ms);
    }
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(status().requests, before + 1);
}

TEST_F(Faults, ManySilentConnectionsDoNotKeepAnHonestClientWaiting) {
  std::vector<RawStream> silent;
  for (int i = 0; i < 300; ++i) silent.emplace_back(server_.endpoint("tcp"));
  const auto started = std::chrono::steady_clock::now();
  Client honest = server_.client("tcp");
  EXPECT_LT(std::chrono::steady_clock::now() - started, 4s);
  // The server closes a connection on which no handshake arrives within its time limit.
  EXPECT_TRUE(silent.front().closed_within(8s));
}

TEST_F(Faults, AClientThatLeftMidRequestHasItsStepRunOnce) {
  {
    RawDealer gone(server_.endpoint());
    gone.send(opening(1));
    ASSERT_TRUE(gone.receive_status()->ok());
    gone.send(step_request(1, 1));
    while (status().node_steps < static_cast<std::uint64_t>(steps_ + 1) * kNodes.size())
      std::this_thread::sleep_for(1ms);
  }
  foreign_node_steps_ = kNodes.size();
  RawDealer back(server_.endpoint());
  back.send(step_request(1, 1));
  EXPECT_TRUE(back.receive_status()->ok());
  EXPECT_EQ(status().replayed, 1u);
}

TEST_F(Faults, DestroyedSessionsSayGoodbye) {
  { Session short_lived = client_.open(support::text_of(support::force_scene()), "scene", kNodes); }
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
