// The idle limit of a session, and the states by which the server checks a node's exchange with the host
// (server/shard/closure.hpp), outlive the server: by replay of the journal, by a checkpoint, and by both.
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <vector>

#include "tests/durability/deaths.hpp"

namespace shearbus::service {
namespace {

const std::vector<std::uint64_t> kNodes = support::node_ids(11);
constexpr std::uint64_t kSecond = 1'000'000'000;

wire::Request opening(std::uint64_t idle_limit_s = 0) {
  wire::Request request = ServiceHarness::opening(support::force_scene(), kNodes);
  auto& open = std::get<wire::OpenSession>(request.body);
  open.check_closure = true;
  open.idle_limit_s = idle_limit_s;
  return request;
}

// Returns a request of a faulty host: it does not apply the answered stresses, and its time grows by twice the step
// length. The requests include trial steps, steps of some of the nodes, a mark and a rollback.
wire::Request request_at(std::uint64_t sequence) {
  const int number = static_cast<int>(sequence);
  if (sequence == 4) return ServiceHarness::in_session(wire::Mark{.name = "dump"}, sequence);
  if (sequence == 9) return ServiceHarness::in_session(wire::Rollback{.to_mark = "dump"}, sequence);
  const bool some = sequence % 3 == 2;
  const auto ids = some ? std::span(kNodes).subspan(2, 5) : std::span(kNodes);
  wire::Request request =
      ServiceHarness::step(sequence, support::step_columns(Strategy::kForceDriven, ids, number, some),
                           sequence % 5 == 3 ? wire::Mode::kTrial : wire::Mode::kAdvance);
  auto& step = std::get<wire::Downscale>(request.body);
  step.time_s = 2e-9 * static_cast<double>(sequence);
  step.wanted = {Field::kShearStress, Field::kVelocityJumpNew, Field::kClosure};
  step.absent_nodes = sequence % 2 == 0 ? wire::AbsentNodes::kOpen : wire::AbsentNodes::kKeep;
  return request;
}

struct Told {
  std::vector<std::byte> payload;
  double closure = 0.0, layer_time = 0.0;
  std::uint64_t node = 0;
  std::vector<std::string> warnings;
  bool operator==(const Told&) const = default;
};

Told told(const Answer& answer) {
  EXPECT_TRUE(answer.reply.status.ok()) << describe(answer.reply.status);
  Told told{.payload = answer.payload()};
  if (const auto* step = std::get_if<wire::Upscale>(&answer.reply.body)) {
    told.closure = step->largest_closure_m_per_s;
    told.layer_time = step->layer_time_s;
    told.node = step->closure_node;
    told.warnings = step->warnings;
  }
  return told;
}

TEST(DurableClosure, ServersThatDieAfterEveryRequestTellTheSame) {
  std::vector<wire::Request> conversation = {opening()};
  for (std::uint64_t i = 1; i <= 14; ++i) conversation.push_back(request_at(i));
  int warnings = 0, differences = 0;
  expect_deaths_change_nothing(conversation, [&](const Answer& answer) {
    const Told all = told(answer);
    warnings += static_cast<int>(all.warnings.size());
    differences += all.closure > 0.0;
    return all;
  });
  EXPECT_GT(warnings, 3);
  EXPECT_GT(differences, 3);
}

TEST(IdleLimit, ClosesTheSessionAsAnOperatorWould) {
  for (const bool checkpoint : {false, true}) {
    MemoryStorage disk;
    {
      DurableServer server(disk);
      ASSERT_TRUE(server.ask(opening(60)).reply.status.ok());
      ASSERT_TRUE(server.ask(request_at(1)).reply.status.ok());
      server.clock += 59 * kSecond;
      server.service.close_idle_sessions();
      EXPECT_EQ(server.service.status().sessions, 1U);
      ASSERT_TRUE(server.ask(request_at(2)).reply.status.ok()) << "a request begins the time anew";
      server.clock += 59 * kSecond;
      server.service.close_idle_sessions();
      EXPECT_EQ(server.service.status().sessions, 1U);
      if (checkpoint) {
        ASSERT_TRUE(server.service.checkpoint());
      }
    }
    {
      // The recovered server keeps the idle limit and counts the idle time from its own start.
      DurableServer server(disk);
      server.service.close_idle_sessions();
      ASSERT_TRUE(server.ask(request_at(3)).reply.status.ok());
      server.clock += 61 * kSecond;
      server.service.close_idle_sessions();
      EXPECT_EQ(server.service.status().sessions, 0U);
      EXPECT_EQ(server.service.status().state_bytes, 0U);
      const Answer late = server.ask(request_at(4));
      EXPECT_EQ(late.code(), Code::kUnknownSession);
      EXPECT_NE(late.reply.status.text.find("idle for 61 s, its client allowed 60 s"), std::string::npos)
          << late.reply.status.text;
    }
    // The journal holds the request that closed the session, so the session stays closed whatever the clock of the next
    // server.
    DurableServer server(disk);
    EXPECT_EQ(server.service.status().sessions, 0U);
    EXPECT_EQ(server.ask(request_at(4)).code(), Code::kUnknownSession);
    EXPECT_EQ(server.ask(request_at(5)).code(), Code::kUnknownSession);
  }
}

TEST(IdleLimit, IsForEverWhereTheClientGaveNone) {
  MemoryStorage disk;
  DurableServer server(disk);
  ASSERT_TRUE(server.ask(opening()).reply.status.ok());
  server.clock += 10'000'000 * kSecond;
  server.service.close_idle_sessions();
  EXPECT_TRUE(server.ask(request_at(1)).reply.status.ok());
}

TEST(IdleLimit, AHolderOfNodesIsNamedWithItsAgeAndTheCommandThatFreesThem) {
  MemoryStorage disk;
  DurableServer server(disk);
  wire::Request first = opening();
  std::get<wire::OpenSession>(first.body).domain = "it's a run";
  ASSERT_TRUE(server.ask(first).reply.status.ok());
  server.clock += 100 * kSecond;
  ASSERT_TRUE(server.ask(request_at(1)).reply.status.ok());
  server.clock += 30 * kSecond;
  wire::Request second = ServiceHarness::opening(support::force_scene(), kNodes, 2);
  std::get<wire::OpenSession>(second.body).domain = "it's a run";
  const Answer refused = server.ask(second);
  EXPECT_EQ(refused.code(), Code::kNodeOwned);
  EXPECT_NE(refused.reply.status.text.find("opened 130 s ago and idle for 30 s"), std::string::npos)
      << refused.reply.status.text;
  EXPECT_NE(refused.reply.status.remedy.find(R"(shearbus-ctl close --domain 'it'\''s a run')"), std::string::npos)
      << refused.reply.status.remedy;
}

}  // namespace
}  // namespace shearbus::service
