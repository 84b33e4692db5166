// A client whose server is restarted again and again, on a machine so slow that each restart takes longer than the
// deadline of a call.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <variant>

#include "client/src/client.hpp"
#include "client/src/connection.hpp"

namespace shearbus {
namespace {

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

}  // namespace
}  // namespace shearbus
