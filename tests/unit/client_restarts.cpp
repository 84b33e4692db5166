// A client whose server is restarted again and again: on a machine so slow that each restart takes longer than the
// deadline of a call, and before the answers to its claims.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <variant>

#include "client/src/client.hpp"
#include "client/src/connection.hpp"
#include "tests/support/direct_connection.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using support::code_of;
using namespace std::chrono_literals;

// Answers as a server that restarts `restarts` times: each time between a client's question where its session stands
// and its claim.
class Restarting final : public Connection {
 public:
  Restarting() : Connection({.reply_deadline = 10s}) {}

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override {
    EXPECT_GT(deadline, 0ms);
    Received received;
    wire::Reply& reply = received.reply;
    reply.epoch = epoch_;
    if (std::holds_alternative<wire::Hello>(request.body)) {
      reply.body = wire::Welcome{.durability = "memory"};
    } else if (const auto* resume = std::get_if<wire::ResumeSession>(&request.body)) {
      if (resume->claim != 0 && restarts > 0) restart();
      check(request);
      reply.body = wire::SessionResumed{.claim = resume->claim};
    } else if (std::holds_alternative<wire::OpenSession>(request.body)) {
      reply.body = wire::SessionOpened{};
    } else {
      check(request);
      reply.body = wire::RolledBack{};
    }
    return received;
  }
  void say(const wire::Request&) noexcept override {}
  Clock::time_point now() const override { return now_; }
  void pause(std::chrono::milliseconds time) override { now_ += time; }

  void restart() {
    --restarts;
    ++epoch_;
    now_ += 11s;
  }
  int restarts = 0;

 private:
  void check(const wire::Request& request) const {
    if (request.epoch != 0 && request.epoch != epoch_) throw Error({.code = wire::Code::kEpoch, .text = "restarted"});
  }

  Clock::time_point now_{};
  std::uint64_t epoch_ = 1;
};

struct Hosted {
  std::shared_ptr<Restarting> connection = std::make_shared<Restarting>();
  Client client{std::shared_ptr<Connection>(connection)};
  Session session = client.open("", "", {});
};

TEST(ClientRestarts, AreFollowedHoweverLongTheyTake) {
  Hosted host;
  host.connection->restart();
  host.connection->restarts = 3;
  EXPECT_NO_THROW(host.session.rollback());
  EXPECT_EQ(host.connection->restarts, 0);
}

TEST(ClientRestarts, AreFollowedByASuccessor) {
  Hosted host;
  host.connection->restarts = 3;
  EXPECT_NO_THROW(host.client.resume(host.session.ticket()));
  EXPECT_EQ(host.connection->restarts, 0);
}

TEST(ClientRestarts, WithoutEndEndTheCall) {
  Hosted host;
  host.connection->restart();
  host.connection->restarts = 1'000'000;
  try {
    host.session.rollback();
    FAIL();
  } catch (const Error& fault) {
    EXPECT_EQ(fault.status().code, wire::Code::kEpoch);
  }
  host.connection->restarts = 0;  // the session's goodbye
}

// Connections to one durable server, which may be restarted before the answer to a claim arrives.
struct Restarted {
  void restart() {
    server.reset();
    disk.die_of_process();
    server = std::make_unique<support::DurableServer>(disk, store::Durability::kProcess, ++starts << 32);
  }
  support::MemoryStorage disk;
  std::uint64_t starts = 0;
  std::unique_ptr<support::DurableServer> server;
  int claims_to_lose = 0;
};

class LosingConnection final : public Connection {
 public:
  explicit LosingConnection(Restarted& server) : Connection({}), server_(server) {}
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    support::Answer answer = server_.server->ask(request);
    const auto* resume = std::get_if<wire::ResumeSession>(&request.body);
    if (resume != nullptr && resume->claim != 0 && server_.claims_to_lose > 0) {
      --server_.claims_to_lose;
      server_.restart();
      throw Error({.code = Code::kUnknownOutcome, .text = "no answer"});
    }
    return support::received(std::move(answer));
  }
  void say(const wire::Request&) noexcept override {}

 private:
  Restarted& server_;
};

// A claim was granted and its answer was lost. The restarted server refuses a repetition of it, and the requests that
// are older than the claim, but it names the client that it was granted to.
TEST(ClientRestarts, BeforeTheAnswersToClaimsLeaveTheSessionToItsClient) {
  Restarted server;
  server.restart();
  Client client(std::make_shared<LosingConnection>(server));
  const auto nodes = support::node_ids(5);
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", nodes);
  const auto step = [&](int number) {
    session.advance(support::step_columns(wire::Strategy::kVelocityDriven, nodes, number), {.dt_s = 1e-9});
  };
  step(0);
  server.restart();
  server.claims_to_lose = 2;
  EXPECT_EQ(code_of([&] { step(1); }), Code::kUnknownOutcome);
  EXPECT_EQ(code_of([&] { step(1); }), Code::kUnknownOutcome);
  EXPECT_EQ(code_of([&] { step(1); }), Code::kOk);
  EXPECT_EQ(session.rollback(), 2u);

  // Another client has claimed the session since.
  server.restart();
  server.claims_to_lose = 1;
  EXPECT_EQ(code_of([&] { step(2); }), Code::kUnknownOutcome);
  Client other(std::make_shared<LosingConnection>(server));
  Session successor = other.resume(session.ticket());
  server.restart();
  for (int repeats = 0; repeats < 2; ++repeats) EXPECT_EQ(code_of([&] { step(2); }), Code::kSuperseded);
  session.leave();
  successor.close();
}

}  // namespace
}  // namespace shearbus
