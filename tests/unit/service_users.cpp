// Quotas of users, and what a user sees of the others. P8: one user cannot take what others need.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const Caller kAlice{.identity = "uid 1001"};
const Caller kBob{.identity = "uid 1002"};
const Caller kOperator{.identity = "uid 0", .is_operator = true};
const std::vector<std::uint64_t> kNodes = support::node_ids(64);

Code open(ServiceHarness& harness, std::uint8_t session, const Caller& caller) {
  return harness.ask(ServiceHarness::opening(support::force_scene(), kNodes, session), caller).code();
}

wire::ServerStatus status_of(ServiceHarness& harness, const Caller& caller) {
  return std::get<wire::ServerStatus>(harness.ask({.body = wire::ServerStatusQuery{}}, caller).reply.body);
}

TEST(Users, HaveAQuotaOfSessionsAndOperatorsHaveNone) {
  ServiceHarness harness(1, {.max_sessions = 8, .max_sessions_per_user = 3});
  for (std::uint8_t session = 1; session <= 3; ++session) ASSERT_EQ(open(harness, session, kAlice), Code::kOk);
  const Answer fourth = harness.ask(ServiceHarness::opening(support::force_scene(), kNodes, 4), kAlice);
  EXPECT_EQ(fourth.code(), Code::kLimit);
  EXPECT_THAT(describe(fourth.reply.status),
              AllOf(HasSubstr("uid 1001 has 3 sessions"), HasSubstr("quota"), HasSubstr("--sessions-per-user")));
  EXPECT_EQ(open(harness, 3, kAlice), Code::kOk) << "a repeated opening is answered";
  EXPECT_EQ(open(harness, 4, kBob), Code::kOk);
  for (std::uint8_t session = 5; session <= 8; ++session) EXPECT_EQ(open(harness, session, kOperator), Code::kOk);
  ASSERT_EQ(harness.ask(ServiceHarness::in_session(wire::CloseSession{}, 1, 1), kAlice).code(), Code::kOk);
  EXPECT_EQ(open(harness, 9, kAlice), Code::kOk);
  const auto limits = [&](const Caller& caller) {
    return std::get<wire::Welcome>(harness.ask({.body = wire::Hello{}}, caller).reply.body).limits;
  };
  EXPECT_EQ(limits(kAlice).max_sessions_per_user, 3u);
  EXPECT_EQ(limits(kOperator).max_sessions_per_user, 8u);
}

TEST(Users, HaveAQuotaOfMemoryForNodesMarksAndOffers) {
  std::uint64_t bytes = 0;
  {
    ServiceHarness harness;
    ASSERT_EQ(open(harness, 1, kAlice), Code::kOk);
    bytes = status_of(harness, kAlice).state_bytes;
  }
  ServiceHarness harness(1, {.max_state_bytes_per_user = 2 * bytes});
  ASSERT_EQ(open(harness, 1, kAlice), Code::kOk);
  ASSERT_EQ(open(harness, 2, kAlice), Code::kOk);
  const auto refused = [&](const wire::Request& request) {
    const Answer answer = harness.ask(request, kAlice);
    EXPECT_EQ(answer.code(), Code::kLimit);
    EXPECT_THAT(describe(answer.reply.status),
                AllOf(HasSubstr("uid 1001 has"), HasSubstr("quota of a user"), HasSubstr("--memory-per-user-mb")));
  };
  refused(ServiceHarness::opening(support::force_scene(), kNodes, 3));
  refused(ServiceHarness::in_session(wire::Mark{.name = "dump"}, 1));
  wire::Request more = ServiceHarness::in_session(wire::RegisterNodes{}, 1);
  more.batch = ServiceHarness::opening(support::force_scene(), support::node_ids(8, 5000)).batch;
  refused(more);
  EXPECT_EQ(open(harness, 3, kBob), Code::kOk);
  EXPECT_EQ(harness.ask(more, kOperator).code(), Code::kOk) << "an operator may act for the user";
}

TEST(Users, SeeTheirOwnSessionsAndCountersOnly) {
  ServiceHarness harness;
  ASSERT_EQ(open(harness, 1, kAlice), Code::kOk);
  ASSERT_EQ(open(harness, 2, kBob), Code::kOk);
  for (std::uint64_t sequence = 1; sequence <= 3; ++sequence)
    ASSERT_EQ(
        harness
            .ask(ServiceHarness::step(sequence, support::step_columns(wire::Strategy::kForceDriven, kNodes, 1)), kAlice)
            .code(),
        Code::kOk);
  EXPECT_EQ(harness.ask(ServiceHarness::in_session(wire::Commit{}, 4), kAlice).code(), Code::kNothingToCommit);
  const wire::ServerStatus alice = status_of(harness, kAlice), bob = status_of(harness, kBob),
                           all = status_of(harness, kOperator);
  EXPECT_EQ(alice.sessions, 1u);
  EXPECT_EQ(alice.nodes, kNodes.size());
  EXPECT_EQ(alice.node_steps, 3 * kNodes.size());
  EXPECT_EQ(alice.requests, 6u);
  EXPECT_EQ(alice.refused, 1u);
  EXPECT_EQ(bob.node_steps, 0u);
  EXPECT_EQ(bob.requests, 2u);
  EXPECT_EQ(bob.refused, 0u);
  EXPECT_TRUE(bob.histograms.empty());
  EXPECT_TRUE(bob.refusals.empty());
  EXPECT_EQ(all.sessions, 2u);
  EXPECT_EQ(all.nodes, 2 * kNodes.size());
  EXPECT_FALSE(all.histograms.empty());
}

TEST(Users, SeeTheRegimesOfTheirOwnCommittedStates) {
  ServiceHarness harness;
  ASSERT_EQ(open(harness, 1, kAlice), Code::kOk);
  ASSERT_EQ(open(harness, 2, kBob), Code::kOk);
  const std::uint64_t all = kNodes.size();
  const std::vector<std::uint64_t> nobody(wire::kRegimeCount, 0), open_only = {all, 0, 0, 0, 0};
  EXPECT_EQ(status_of(harness, kAlice).regimes, open_only) << "a new layer has no contact";

  wire::Request step = ServiceHarness::step(1, support::step_columns(wire::Strategy::kForceDriven, kNodes, 1));
  std::get<wire::Downscale>(step.body).mode = wire::Mode::kTrial;
  const Answer trial = harness.ask(step, kAlice);
  ASSERT_EQ(trial.code(), Code::kOk);
  EXPECT_EQ(status_of(harness, kAlice).regimes, open_only) << "a trial is no committed state";
  ASSERT_EQ(harness.ask(ServiceHarness::in_session(wire::Commit{}, 2), kAlice).code(), Code::kOk);

  std::vector<std::uint64_t> answered = nobody;
  for (const std::uint8_t regime : std::as_const(trial.reply.batch).u8(wire::Field::kRegime)) ++answered[regime];
  ASSERT_NE(answered, open_only);
  EXPECT_EQ(status_of(harness, kAlice).regimes, answered);
  EXPECT_EQ(status_of(harness, kBob).regimes, open_only);
  EXPECT_EQ(status_of(harness, {.identity = "uid 1003"}).regimes, nobody);
  std::vector<std::uint64_t> of_all = answered;
  of_all[0] += all;
  EXPECT_EQ(status_of(harness, kOperator).regimes, of_all);

  wire::Request inspect{.body = wire::Inspect{}};
  const auto sessions = std::get<wire::Inspected>(harness.ask(inspect, kOperator).reply.body).sessions;
  ASSERT_EQ(sessions.size(), 2u);
  EXPECT_EQ(sessions[0].regimes, answered);
  EXPECT_EQ(sessions[1].regimes, open_only);
}

}  // namespace
}  // namespace shearbus::service
