// What a client sends of a step in parts, and in which order, to a server that answers from a script.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/src/client.hpp"
#include "client/src/connection.hpp"
#include "proto/wire/codec.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using ::testing::ElementsAre;

constexpr std::size_t kRows = 2;  // of a message

std::uint64_t hash_of(const std::string& header) {
  const std::array<std::span<const std::byte>, 1> frames = {std::as_bytes(std::span(header))};
  return wire::hash_of(frames);
}

// A server of steps: it answers each part, but refuses the calls that refuse() names.
class Scripted final : public Connection {
 public:
  explicit Scripted(bool takes_parts_ahead) : Connection({}), takes_parts_ahead_(takes_parts_ahead) {}

  void post(const wire::Request& request) override { note("post", request); }
  void post_behind(const wire::Request& request) override { note("behind", request); }
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    Received received;
    wire::Reply& reply = received.reply;
    reply.epoch = epoch;
    if (std::holds_alternative<wire::Hello>(request.body)) {
      wire::Welcome welcome{.durability = "process"};
      welcome.limits.max_rows_per_message = kRows;
      if (takes_parts_ahead_) welcome.capabilities = {"parts_ahead"};
      reply.body = std::move(welcome);
    } else if (std::holds_alternative<wire::OpenSession>(request.body)) {
      reply.body = wire::SessionOpened{.strategy = wire::Strategy::kVelocityDriven,
                                       .tangential_components = 1,
                                       .required_columns = {Field::kPressure, Field::kVelocityJump},
                                       .reply_columns = {Field::kShearStress}};
    } else if (const auto* resume = std::get_if<wire::ResumeSession>(&request.body)) {
      reply.body = wire::SessionResumed{.last_sequence = last_sequence, .claim = resume->claim};
    } else if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
      note("call", request);
      if (request.epoch != 0 && request.epoch != epoch) throw Error({.code = Code::kEpoch, .text = "restarted"});
      if (!refusals.empty() && refusals.front().first == step->part) {
        const Code code = refusals.front().second;
        refusals.erase(refusals.begin());
        if (code == Code::kEpoch) ++epoch;
        throw Error({.code = code, .text = "refused"});
      }
      EXPECT_EQ(request.sequence, last_sequence + 1);
      last_sequence = request.sequence;
      if (step->follows != 0) {
        EXPECT_EQ(step->follows, hash_of(accepted_)) << "as a server requires it";
      }
      accepted_ = wire::encode_header(request);
      reply.body = wire::Upscale{.nodes = request.batch.columns().front().count};
      reply.batch = Batch::of(std::vector{Field::kShearStress}, request.batch.columns().front().count);
      for (double& stress : reply.batch.f64(Field::kShearStress)) stress = step->part;
    } else {
      EXPECT_TRUE(std::holds_alternative<wire::Rollback>(request.body));
      events.emplace_back("rollback");
      last_sequence = request.sequence;
      reply.body = wire::RolledBack{};
    }
    return received;
  }
  void say(const wire::Request&) noexcept override {}

  std::vector<std::string> events;                                // such as "post 1"
  std::vector<std::uint64_t> follows;                             // of the part of each event
  std::vector<std::vector<std::string>> headers{{}, {}, {}, {}};  // of each part, by its number
  std::vector<std::pair<std::uint32_t, Code>> refusals;           // of parts, in this order
  std::uint64_t epoch = 1;
  std::uint64_t last_sequence = 0;

 private:
  void note(const std::string& what, const wire::Request& request) {
    const auto& step = std::get<wire::Downscale>(request.body);
    events.push_back(what + " " + std::to_string(step.part));
    headers.at(step.part).push_back(wire::encode_header(request));
    follows.push_back(step.follows);
  }

  bool takes_parts_ahead_;
  std::string accepted_;  // header of the last part that ran
};

struct Host {
  explicit Host(bool takes_parts_ahead = true)
      : connection(std::make_shared<Scripted>(takes_parts_ahead)), client(std::shared_ptr<Connection>(connection)) {
    session.emplace(client.open("", "", nodes));
  }
  Code advance() {
    const Batch columns = support::step_columns(wire::Strategy::kVelocityDriven, nodes, 0);
    return support::code_of([&] {
      const auto stress = session->advance(columns, {.dt_s = 1e-9}).shear_stress_pa();
      EXPECT_THAT(std::vector(stress.begin(), stress.end()), ElementsAre(1.0, 1.0, 2.0, 2.0, 3.0));
    });
  }
  std::vector<std::uint64_t> nodes = support::node_ids(2 * kRows + 1);
  std::shared_ptr<Scripted> connection;
  Client client;
  std::optional<Session> session;
};

TEST(ClientParts, AreSentOneAhead) {
  Host host;
  ASSERT_EQ(host.advance(), Code::kOk);
  const Scripted& sent = *host.connection;
  EXPECT_THAT(sent.events, ElementsAre("post 1", "behind 2", "call 1", "behind 3", "call 2", "call 3"));
  for (const std::size_t part : {1U, 2U, 3U}) EXPECT_EQ(sent.headers[part].front(), sent.headers[part].back());
  const std::uint64_t one = hash_of(sent.headers[1].front()), two = hash_of(sent.headers[2].front());
  EXPECT_THAT(sent.follows, ElementsAre(0U, one, 0U, two, one, two));
}

TEST(ClientParts, AreSentOneAfterTheOtherToAServerThatTakesNoneAhead) {
  Host host(false);
  ASSERT_EQ(host.advance(), Code::kOk);
  EXPECT_THAT(host.connection->events, ElementsAre("post 1", "call 1", "post 2", "call 2", "post 3", "call 3"));
  EXPECT_THAT(host.connection->follows, testing::Each(0U));
}

TEST(ClientParts, WithoutAnAnswerAreSentAgainWithTheSameBytes) {
  for (const std::uint32_t lost : {1U, 2U, 3U}) {
    Host host;
    host.connection->refusals = {{lost, Code::kUnknownOutcome}, {lost, Code::kUnreachable}};
    EXPECT_EQ(host.advance(), Code::kUnknownOutcome);
    EXPECT_EQ(host.advance(), Code::kUnreachable);
    EXPECT_EQ(host.advance(), Code::kOk);
    for (const std::uint32_t part : {1U, 2U, 3U})
      EXPECT_THAT(host.connection->headers[part], testing::Each(host.connection->headers[part].front()));
  }
}

TEST(ClientParts, BehindARefusedOneAreGivenUp) {
  Host host;
  host.connection->refusals = {{2, Code::kInvalidValue}};
  EXPECT_EQ(host.advance(), Code::kInvalidValue);
  EXPECT_THAT(host.connection->events, ElementsAre("post 1", "behind 2", "call 1", "behind 3", "call 2", "rollback"));
  host.connection->events.clear();
  EXPECT_EQ(host.advance(), Code::kOk);
  EXPECT_THAT(host.connection->events, ElementsAre("post 1", "behind 2", "call 1", "behind 3", "call 2", "call 3"));
}

TEST(ClientParts, ThatHaveOvertakenThePartBeforeAreSentAgain) {
  Host host;
  host.connection->refusals = {{3, Code::kSequenceGap}};
  EXPECT_EQ(host.advance(), Code::kOk);
  host.connection->refusals = {{1, Code::kSequenceGap}};
  EXPECT_EQ(host.advance(), Code::kSequenceGap) << "nothing was before it";
  host.connection->refusals = {{3, Code::kSequenceGap}, {3, Code::kSequenceGap}};
  EXPECT_EQ(host.advance(), Code::kSequenceGap) << "once";
}

// A part that had not run before the server came back gets another epoch, so the part behind it is made anew.
TEST(ClientParts, FollowARestartOfTheServer) {
  for (const std::uint32_t refused : {1U, 2U, 3U}) {
    Host host;
    host.connection->refusals = {{refused, Code::kEpoch}};
    ASSERT_EQ(host.advance(), Code::kOk);
    EXPECT_EQ(host.connection->epoch, 2u);
    EXPECT_EQ(host.connection->last_sequence, 3u);
    ASSERT_EQ(host.advance(), Code::kOk);
    EXPECT_EQ(host.connection->last_sequence, 6u);
  }
}

}  // namespace
}  // namespace shearbus
