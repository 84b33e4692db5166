// Requests that operators send to a server, and the counters of the service, tested without a socket.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using ::testing::HasSubstr;

const service::Caller kOperator{.identity = "uid 7", .is_operator = true};
const service::Caller kOther{.identity = "key other"};
const std::vector<std::uint64_t> kNodes = support::node_ids(20);

wire::Request asking(decltype(wire::Request::body) body, wire::SessionId session = {}) {
  wire::Request request;
  request.request_id = 5;
  request.session_id = session;
  request.body = std::move(body);
  return request;
}

wire::ServerStatus status_of(ServiceHarness& harness) {
  return std::get<wire::ServerStatus>(harness.ask(asking(wire::ServerStatusQuery{}), kOperator).reply.body);
}

std::uint64_t count_of(const wire::ServerStatus& status, const std::string& name, const std::string& verb = "") {
  for (const wire::Histogram& histogram : status.histograms)
    if (histogram.name == name && histogram.verb == verb)
      return std::accumulate(histogram.counts.begin(), histogram.counts.end(), std::uint64_t{0});
  return 0;
}

TEST(Histogram, EveryDurationFallsIntoTheBucketOfItsPowerOfTwo) {
  const std::pair<std::uint64_t, std::size_t> cases[] = {{0, 0},
                                                         {1023, 0},
                                                         {1024, 1},
                                                         {2047, 1},
                                                         {2048, 2},
                                                         {std::uint64_t{1} << 35, 26},
                                                         {(std::uint64_t{1} << 36) - 1, 26},
                                                         {std::uint64_t{1} << 36, 27},
                                                         {~std::uint64_t{0} >> 1, 27}};
  for (const auto& [ns, bucket] : cases) {
    service::Histogram histogram;
    EXPECT_TRUE(histogram.empty());
    histogram.add(ns);
    const wire::Histogram told = histogram.on_wire("x");
    ASSERT_EQ(told.counts.size(), service::Histogram::kBuckets);
    EXPECT_EQ(told.counts[bucket], 1u) << ns;
    EXPECT_EQ(told.sum_ns, ns);
    EXPECT_FALSE(histogram.empty());
  }
}

TEST(Operations, AnotherThanAnOperatorIsRefusedAndNothingHappens) {
  ServiceHarness harness;
  for (const auto& request : {asking(wire::Checkpoint{}), asking(wire::Drain{.exit = true}), asking(wire::Inspect{})})
    for (const service::Caller& caller : {kOther, service::Caller{}})
      EXPECT_EQ(harness.ask(request, caller).code(), Code::kNotPermitted);
  EXPECT_FALSE(harness.service.drained());
  EXPECT_TRUE(harness.ask(ServiceHarness::opening(support::force_scene(), kNodes), kOther).reply.status.ok());
  EXPECT_THAT(harness.log.front(), HasSubstr("REFUSED: key other"));
}

TEST(Operations, RequestsAreCountedByVerbAndRefusalsByCode) {
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(support::force_scene(), kNodes));
  for (std::uint64_t i = 1; i <= 3; ++i)
    harness.ask(ServiceHarness::step(i, support::step_columns(Strategy::kForceDriven, kNodes, 0)));
  harness.ask(ServiceHarness::in_session(wire::Commit{}, 4));
  harness.ask(ServiceHarness::in_session(wire::Commit{}, 9));
  harness.ask_bytes({});
  const wire::ServerStatus status = status_of(harness);
  EXPECT_EQ(count_of(status, "request", "open_session"), 1u);
  EXPECT_EQ(count_of(status, "request", "downscale"), 3u);
  EXPECT_EQ(count_of(status, "request", "commit"), 2u);
  EXPECT_EQ(count_of(status, "solver"), 3u);
  EXPECT_EQ(count_of(status, "journal_append"), 0u);
  ASSERT_EQ(status.refusals.size(), 3u);
  EXPECT_EQ(status.refusals[0].code, static_cast<std::uint32_t>(Code::kBadFraming));
  EXPECT_EQ(status.refusals[1].code, static_cast<std::uint32_t>(Code::kSequenceGap));
  EXPECT_EQ(status.refusals[2].code, static_cast<std::uint32_t>(Code::kNothingToCommit));
  EXPECT_EQ(status.refused, 3u);
}

TEST(Operations, SessionsAreListedPageByPage) {
  ServiceHarness harness;
  constexpr std::size_t kSessions = wire::kMaxSessionsListed + 3;
  const std::vector<std::uint64_t> node = {1};
  for (std::size_t i = 0; i < kSessions; ++i) {
    wire::Request request = ServiceHarness::opening(support::force_scene(), node);
    auto& id = std::get<wire::OpenSession>(request.body).session_id;
    id = {};
    id[0] = static_cast<std::uint8_t>(i / 100 + 1);
    id[1] = static_cast<std::uint8_t>(i % 100);
    harness.granted(request, kOther);
  }
  const auto first = std::get<wire::Inspected>(harness.ask(asking(wire::Inspect{}), kOperator).reply.body);
  ASSERT_EQ(first.sessions.size(), wire::kMaxSessionsListed);
  EXPECT_TRUE(first.more);
  EXPECT_EQ(first.sessions[0].identity, "key other");
  EXPECT_EQ(first.sessions[0].nodes, 1u);
  const auto second = std::get<wire::Inspected>(
      harness.ask(asking(wire::Inspect{.after = first.sessions.back().session_id}), kOperator).reply.body);
  EXPECT_EQ(second.sessions.size(), 3u);
  EXPECT_FALSE(second.more);
  EXPECT_GT(second.sessions[0].session_id, first.sessions.back().session_id);
}

class Top : public testing::Test {
 protected:
  Top() {
    harness.ask(ServiceHarness::opening(support::velocity_scene(), kNodes), kOther);
    for (std::uint64_t i = 1; i <= 3; ++i)
      answer =
          harness.ask(ServiceHarness::step(i, support::step_columns(Strategy::kVelocityDriven, kNodes, 0)), kOther);
  }
  Answer top(wire::Top by, std::uint32_t count) {
    return harness.ask(asking(wire::Inspect{.top = by, .count = count}, ServiceHarness::id(1)), kOperator);
  }
  ServiceHarness harness;
  Answer answer;
};

TEST_F(Top, HottestAndFastestAreThoseOfTheLastAnswer) {
  for (const auto& [by, field] : {std::pair{wire::Top::kHottest, Field::kInterfaceTemperature},
                                  std::pair{wire::Top::kFastest, Field::kSlidingVelocity}}) {
    std::vector<std::size_t> rows(kNodes.size());
    std::iota(rows.begin(), rows.end(), 0);
    const auto column = std::as_const(answer.reply.batch).f64(field);
    std::ranges::stable_sort(rows,
                             [&](std::size_t a, std::size_t b) { return std::abs(column[a]) > std::abs(column[b]); });
    const Answer found = top(by, 5);
    ASSERT_TRUE(found.reply.status.ok()) << describe(found.reply.status);
    const auto& told = std::get<wire::Inspected>(found.reply.body);
    EXPECT_EQ(told.matching, kNodes.size());
    ASSERT_EQ(found.reply.batch.u64(Field::kNodeId).size(), 5u);
    for (std::size_t i = 0; i < 5; ++i) {
      EXPECT_EQ(found.reply.batch.u64(Field::kNodeId)[i], kNodes[rows[i]]) << i;
      EXPECT_EQ(found.reply.batch.f64(field)[i], column[rows[i]]);
      EXPECT_EQ(found.reply.batch.f64(Field::kShearStress)[i], answer.reply.batch.f64(Field::kShearStress)[rows[i]]);
      EXPECT_EQ(found.reply.batch.u8(Field::kRegime)[i], answer.reply.batch.u8(Field::kRegime)[rows[i]]);
    }
  }
  EXPECT_EQ(top(wire::Top::kHottest, 1000).reply.batch.u64(Field::kNodeId).size(), kNodes.size());
  EXPECT_EQ(std::get<wire::Inspected>(top(wire::Top::kMolten, 5).reply.body).matching, 0u);
}

TEST(Operations, WithoutAProfileTheHottestAreToldToo) {
  const v1::Scene scene = support::modes_scene();
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(scene, kNodes), kOther);
  const Answer answer =
      harness.ask(ServiceHarness::step(1, support::step_columns(Strategy::kForceDriven, kNodes, 0)), kOther);
  const Answer found =
      harness.granted(asking(wire::Inspect{.top = wire::Top::kHottest, .count = 1}, ServiceHarness::id(1)), kOperator);
  const auto column = answer.reply.batch.f64(Field::kInterfaceTemperature);
  EXPECT_EQ(found.reply.batch.f64(Field::kInterfaceTemperature)[0], *std::ranges::max_element(column));
}

TEST_F(Top, LookingChangesNothing) {
  ServiceHarness twin;
  twin.ask(ServiceHarness::opening(support::velocity_scene(), kNodes));
  for (std::uint64_t i = 1; i <= 3; ++i)
    twin.ask(ServiceHarness::step(i, support::step_columns(Strategy::kVelocityDriven, kNodes, 0)));
  top(wire::Top::kHottest, 5);
  top(wire::Top::kFastest, 5);
  const auto next = ServiceHarness::step(4, support::step_columns(Strategy::kVelocityDriven, kNodes, 1));
  EXPECT_EQ(harness.ask(next, kOther).payload(), twin.ask(next).payload());
}

TEST_F(Top, WhatCannotBeToldIsRefusedWithTheReason) {
  EXPECT_EQ(top(wire::Top::kUnspecified, 5).code(), Code::kInvalidValue);
  EXPECT_EQ(top(wire::Top::kHottest, wire::kMaxTopNodes + 1).code(), Code::kLimit);
  EXPECT_EQ(harness.ask(asking(wire::Inspect{}, ServiceHarness::id(9)), kOperator).code(), Code::kUnknownSession);
  const std::vector<std::uint64_t> some = {kNodes[3], kNodes[1]};
  harness.ask(ServiceHarness::step(4, support::step_columns(Strategy::kVelocityDriven, some, 1, true)), kOther);
  EXPECT_EQ(top(wire::Top::kFastest, 5).code(), Code::kInvalidValue);
  EXPECT_TRUE(top(wire::Top::kHottest, 5).reply.status.ok());
}

TEST(Operations, ADrainedServerFinishesWhatItHasAndOpensNothing) {
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(support::force_scene(), kNodes));
  const auto draining = harness.ask(asking(wire::Drain{}), kOperator);
  EXPECT_EQ(std::get<wire::Draining>(draining.reply.body).sessions, 1u);
  EXPECT_EQ(harness.ask(ServiceHarness::opening(support::force_scene(), kNodes, 2)).code(), Code::kDraining);
  EXPECT_TRUE(harness.ask(ServiceHarness::opening(support::force_scene(), kNodes)).reply.status.ok()) << "a repeat";
  EXPECT_TRUE(
      harness.ask(ServiceHarness::step(1, support::step_columns(Strategy::kForceDriven, kNodes, 0))).reply.status.ok());
  EXPECT_TRUE(status_of(harness).draining);
  harness.ask(ServiceHarness::in_session(wire::CloseSession{}, 2));
  EXPECT_FALSE(harness.service.drained()) << "it was not asked to end";
  harness.ask(asking(wire::Drain{.exit = true}), kOperator);
  EXPECT_TRUE(harness.service.drained());
}

TEST(Operations, ADrainedServerEndsAfterTheTimeThatItGaveItsSessions) {
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(support::force_scene(), kNodes));
  EXPECT_EQ(harness.ask(asking(wire::Drain{.within_s = 30}), kOperator).code(), Code::kInvalidValue) << "without exit";
  const auto endless = harness.ask(asking(wire::Drain{.exit = true, .within_s = ~std::uint64_t{0}}), kOperator);
  EXPECT_EQ(endless.reply.status.field, "drain.within_s");
  EXPECT_FALSE(status_of(harness).draining) << "a refused drain changes nothing";

  EXPECT_TRUE(harness.ask(asking(wire::Drain{.exit = true, .within_s = 30}), kOperator).reply.status.ok());
  harness.clock += 29'000'000'000;
  EXPECT_FALSE(harness.service.drained());
  harness.ask(asking(wire::Drain{.exit = true}), kOperator);
  harness.clock += 2'000'000'000;
  EXPECT_TRUE(harness.service.drained()) << "a drain without a time leaves the time as it is";
  EXPECT_EQ(status_of(harness).sessions, 1u) << "the session is left to the checkpoint";
  harness.ask(asking(wire::Drain{.exit = true, .within_s = 30}), kOperator);
  EXPECT_FALSE(harness.service.drained()) << "a later time replaces an earlier one";
}

TEST(Operations, ACheckpointNeedsAStateDirectory) {
  ServiceHarness harness;
  EXPECT_EQ(harness.ask(asking(wire::Checkpoint{}), kOperator).code(), Code::kUnsupported);
}

}  // namespace
}  // namespace shearbus::service
