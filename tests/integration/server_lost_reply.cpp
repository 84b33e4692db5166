// Tests with a proxy between client and server that loses chosen messages. The client then repeats its request, and the
// server answers with the reply that it has kept.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <deque>
#include <string>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::code_of;
using support::RunningServer;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(10);

// A proxy between clients and a server. It passes messages on, and on demand drops the next requests or replies.
class LossyBus {
 public:
  explicit LossyBus(const std::string& server) : front_(context_, zmq::socket_type::router) {
    front_.set(zmq::sockopt::linger, 0);
    front_.bind("tcp://127.0.0.1:*");
    endpoint_ = front_.get(zmq::sockopt::last_endpoint);
    thread_ = std::thread([this, server] { run(server); });
  }
  LossyBus(const LossyBus&) = delete;
  LossyBus& operator=(const LossyBus&) = delete;
  ~LossyBus() {
    stopping_ = true;
    thread_.join();
  }

  const std::string& endpoint() const { return endpoint_; }
  std::atomic<int> requests_to_lose{0};
  std::atomic<int> replies_to_pass{0};  // before the first that is lost
  std::atomic<int> replies_to_lose{0};
  std::atomic<int> requests_seen{0};
  // From the next request on, so many replies wait until a request more than the replies has come.
  std::atomic<int> replies_to_keep_behind{0};

 private:
  using Message = std::vector<zmq::message_t>;

  static bool receive(zmq::socket_t& socket, Message& message) {
    message.clear();
    for (bool more = true; more;) {
      zmq::message_t frame;
      if (!socket.recv(frame, zmq::recv_flags::dontwait)) return false;
      more = frame.more();
      message.push_back(std::move(frame));
    }
    return true;
  }
  static void send(zmq::socket_t& socket, Message& message) {
    for (std::size_t i = 0; i < message.size(); ++i)
      socket.send(message[i], i + 1 < message.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
  }
  static bool take(std::atomic<int>& counter) {
    if (counter <= 0) return false;
    --counter;
    return true;
  }

  // Passes messages on, through one DEALER socket for each client. A message from a client begins with the client's
  // routing id, followed by the request.
  void run(const std::string& server) {
    std::vector<std::pair<std::string, zmq::socket_t>> links;
    std::deque<Message> kept;
    int ahead = 0;  // requests without a reply, while replies are kept behind
    while (!stopping_) {
      zmq::pollitem_t item{front_.handle(), 0, ZMQ_POLLIN, 0};
      zmq::poll(&item, 1, 2ms);
      Message message;
      while (receive(front_, message)) {
        ++requests_seen;
        if (replies_to_keep_behind > 0) ++ahead;
        const std::string peer = message.front().to_string();
        message.erase(message.begin());
        if (take(requests_to_lose)) continue;
        auto link = std::find_if(links.begin(), links.end(), [&](const auto& l) { return l.first == peer; });
        if (link == links.end()) {
          links.emplace_back(peer, zmq::socket_t(context_, zmq::socket_type::dealer));
          link = links.end() - 1;
          link->second.set(zmq::sockopt::linger, 0);
          link->second.connect(server);
        }
        send(link->second, message);
      }
      for (auto& [peer, link] : links)
        while (receive(link, message)) {
          if (!take(replies_to_pass) && take(replies_to_lose)) continue;
          message.insert(message.begin(), zmq::message_t(peer));
          kept.push_back(std::move(message));
        }
      while (!kept.empty() && (replies_to_keep_behind <= 0 || ahead > 1)) {
        if (take(replies_to_keep_behind)) --ahead;
        send(front_, kept.front());
        kept.pop_front();
      }
    }
  }

  zmq::context_t context_;
  zmq::socket_t front_;
  std::string endpoint_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class LostReply : public testing::Test {
 protected:
  LostReply() : bus_(server_.endpoint()), direct_(server_.client()) {}

  ClientOptions options(std::chrono::milliseconds deadline = 3s) const {
    return {.endpoint = bus_.endpoint(), .reply_deadline = deadline, .retry_after = 150ms};
  }
  // A client that repeats no request within its deadline.
  Client without_repeats(std::chrono::milliseconds deadline) const {
    ClientOptions options = this->options(deadline);
    options.retry_after = 60s;
    options.check_closure = CheckClosure::kOff;
    return Client(options);
  }
  static Session open(Client& client) { return client.open(support::text_of(support::force_scene()), "scene", kNodes); }
  static Batch columns(int step) { return support::step_columns(Strategy::kForceDriven, kNodes, step); }

  RunningServer server_;
  LossyBus bus_;
  Client direct_;
};

TEST_F(LostReply, EveryLossIsMadeGoodAndNothingAgesTwice) {
  Client client(options());
  Session session = open(client);
  Session twin = open(direct_);
  int losses = 0;
  for (int step = 0; step < 12; ++step) {
    if (step % 3 == 0) bus_.replies_to_lose = 1 + step / 6;
    if (step % 3 == 1) bus_.requests_to_lose = 1;
    losses += bus_.replies_to_lose + bus_.requests_to_lose;
    const Batch request = columns(step);
    if (step >= 6) {  // in two halves, between which the host does other work
      session.start(request, {.dt_s = 1e-9});
      std::this_thread::sleep_for(5ms);
    }
    const auto& a = step >= 6 ? session.finish() : session.advance(request, {.dt_s = 1e-9});
    const auto& b = twin.advance(request, {.dt_s = 1e-9});
    ASSERT_TRUE(std::ranges::equal(a.shear_stress_pa(), b.shear_stress_pa())) << step;
    ASSERT_TRUE(std::ranges::equal(a.interface_temperature_k(), b.interface_temperature_k())) << step;
    ASSERT_EQ(a.upscale().state_version, static_cast<std::uint64_t>(step + 1));
  }
  const auto status = direct_.server_status();
  EXPECT_EQ(status.node_steps, 2 * 12 * kNodes.size());
  EXPECT_EQ(status.replayed, 6u);
  EXPECT_EQ(losses, 10);
  EXPECT_THROW(session.finish(), Error);
}

// The client gathers the next part and copies the answers before it while a part is under way. Wherever the answer to a
// part is lost for longer than the deadline, the same call again goes on with that part.
TEST_F(LostReply, AStepInPartsGoesOnWithThePartWhoseAnswerWasLost) {
  const auto nodes = support::node_ids(wire::kMaxRowsPerMessage + 1'000);
  const std::string scene = support::text_of(support::force_scene(1));
  const Batch step = support::step_columns(Strategy::kForceDriven, nodes, 0);
  Session twin = direct_.open(scene, "scene", nodes);
  const StepResult& expected = twin.advance(step, {.dt_s = 1e-9});
  for (int lost = 0; lost < 2; ++lost) {
    Client client = without_repeats(4s);
    Session session = client.open(scene, "scene", nodes);
    bus_.replies_to_pass = lost;
    bus_.replies_to_lose = 100;
    ASSERT_EQ(code_of([&] { session.advance(step, {.dt_s = 1e-9}); }), Code::kUnknownOutcome) << "part " << lost + 1;
    bus_.replies_to_pass = bus_.replies_to_lose = 0;
    const StepResult& found = session.advance(step, {.dt_s = 1e-9});
    ASSERT_EQ(found.upscale().state_version, 1u);
    ASSERT_EQ(found.upscale().nodes, nodes.size());
    const auto same = [&](auto a, auto b) { return std::ranges::equal(a, b); };
    EXPECT_TRUE(same(found.shear_stress_pa(), expected.shear_stress_pa())) << "part " << lost + 1;
    EXPECT_TRUE(same(found.interface_temperature_k(), expected.interface_temperature_k())) << "part " << lost + 1;
    EXPECT_TRUE(same(found.batch().u8(Field::kOutcome), expected.batch().u8(Field::kOutcome))) << "part " << lost + 1;
    EXPECT_EQ(session.close().node_steps, nodes.size());
  }
}

// Each answer but the last is kept until the part behind it has come: a client that waited for it would wait in vain.
TEST_F(LostReply, APartIsOnItsWayBeforeThePartBeforeItIsAnswered) {
  constexpr std::uint64_t kParts = 3;
  const auto nodes = support::node_ids((kParts - 1) * wire::kMaxRowsPerMessage + 1'000);
  const std::string scene = support::text_of(support::force_scene(1));
  Client client = without_repeats(30s);
  Session session = client.open(scene, "scene", nodes);
  Session twin = direct_.open(scene, "scene", nodes);
  const auto replayed = direct_.server_status().replayed;
  for (int i = 0; i < 2; ++i) {
    const Batch step = support::step_columns(Strategy::kForceDriven, nodes, i);
    const StepResult& expected = twin.advance(step, {.dt_s = 1e-9});
    bus_.replies_to_keep_behind = kParts - 1;
    const int seen = bus_.requests_seen;
    if (i == 1) session.start(step, {.dt_s = 1e-9});
    const StepResult& found = i == 1 ? session.finish() : session.advance(step, {.dt_s = 1e-9});
    EXPECT_EQ(bus_.requests_seen, seen + static_cast<int>(kParts));
    EXPECT_TRUE(std::ranges::equal(found.shear_stress_pa(), expected.shear_stress_pa()));
    EXPECT_TRUE(std::ranges::equal(found.interface_temperature_k(), expected.interface_temperature_k()));
    EXPECT_EQ(found.upscale().state_version, static_cast<std::uint64_t>(i + 1));
  }
  EXPECT_EQ(direct_.server_status().replayed, replayed);
}

// start() sends the request at once, so the server computes while the host does other work. When finish()
// is called, the answer has already arrived.
TEST_F(LostReply, AStartedTrialIsComputedWhileTheHostDoesOtherThings) {
  Client client(options());
  Session session = open(client);
  const int seen = bus_.requests_seen;
  const Batch request = columns(0);
  session.start(request, {.dt_s = 1e-9, .mode = wire::Mode::kTrial});
  const auto end = std::chrono::steady_clock::now() + 5s;
  while (direct_.server_status().node_steps == 0 && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(1ms);
  EXPECT_EQ(direct_.server_status().node_steps, kNodes.size());
  EXPECT_EQ(bus_.requests_seen, seen + 1);
  session.finish();
  EXPECT_EQ(bus_.requests_seen, seen + 1);
}

TEST_F(LostReply, AnOpeningOfUnknownOutcomeIsOpenedAgainAsTheSameSession) {
  Client client(options(400ms));
  bus_.replies_to_lose = 1000;
  EXPECT_THROW(client.open(support::text_of(support::force_scene()), "scene", kNodes, {.domain = "run"}), Error);
  bus_.replies_to_lose = 0;
  // The server must recognise the repeated opening. If it ran the opening a second time, it would find its nodes owned
  // by the session of the first opening.
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes, {.domain = "run"});
  EXPECT_EQ(direct_.server_status().sessions, 1u);
  Session other =
      client.open(support::text_of(support::force_scene()), "scene", support::node_ids(3), {.domain = "another"});
  EXPECT_EQ(direct_.server_status().sessions, 2u);
}

TEST_F(LostReply, AnotherCallAfterAnUnknownOutcomeIsToldThatTheLostOneHasRun) {
  Client client(options(400ms));
  Session session = open(client);
  bus_.replies_to_lose = 1000;
  EXPECT_THROW(session.advance(columns(0), {.dt_s = 1e-9}), Error);
  bus_.replies_to_lose = 0;
  EXPECT_EQ(code_of([&] { session.advance(columns(1), {.dt_s = 1e-9}); }), Code::kSequenceReused)
      << "another step was run under the number of the lost one";
  // After a step whose reply was lost the session continues.
  EXPECT_EQ(session.advance(columns(1), {.dt_s = 1e-9}).upscale().state_version, 2u);
}

}  // namespace
}  // namespace shearbus
