// Ownership of nodes: the sessions of a domain register nodes, retire them and hand them over to each other.
#include <gtest/gtest.h>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using Ids = std::vector<std::uint64_t>;

// Several sessions in one domain. Each session has its own sequence numbers.
class Ownership : public testing::Test {
 protected:
  support::Answer open(std::uint8_t session, const Ids& ids, const std::string& domain = "run 1",
                       const v1::Scene& scene = support::velocity_scene()) {
    wire::Request request = ServiceHarness::opening(scene, ids, session);
    std::get<wire::OpenSession>(request.body).domain = domain;
    if (ids.empty()) request.batch = {};
    return harness.ask(request, who);
  }
  template <typename Body>
  support::Answer ask(std::uint8_t session, Body body, const Ids& ids = {},
                      const std::vector<double>& temperatures = {}) {
    wire::Request request = ServiceHarness::in_session(std::move(body), last[session] + 1, session);
    if (!ids.empty()) {
      std::vector<Field> fields = {Field::kNodeId};
      if (!temperatures.empty()) fields.push_back(Field::kInitialTemperature);
      request.batch = wire::Batch::of(fields, ids.size());
      std::ranges::copy(ids, request.batch.u64(Field::kNodeId).begin());
      std::ranges::copy(temperatures, request.batch.f64(Field::kInitialTemperature).begin());
    }
    return counted(session, harness.ask(request, who));
  }
  support::Answer step(std::uint8_t session, const Ids& ids, int number, Mode mode = Mode::kAdvance) {
    return counted(
        session, harness.ask(ServiceHarness::step(
                     last[session] + 1, support::step_columns(Strategy::kVelocityDriven, ids, number), mode, session)));
  }
  static wire::TransferId transfer(std::uint8_t number) {
    wire::TransferId id{};
    id.fill(number);
    return id;
  }
  static Ids ids_of(const support::Answer& answer) {
    const auto ids = std::as_const(answer.reply.batch).u64(Field::kNodeId);
    return {ids.begin(), ids.end()};
  }
  std::vector<double> temperatures(const support::Answer& answer) {
    const auto column = std::as_const(answer.reply.batch).f64(Field::kInterfaceTemperature);
    return {column.begin(), column.end()};
  }
  support::Answer counted(std::uint8_t session, support::Answer answer) {
    if (answer.code() == Code::kOk) ++last[session];
    return answer;
  }
  std::uint64_t bytes() { return harness.service.status().state_bytes; }
  std::uint64_t nodes() { return harness.service.status().nodes; }

  ServiceHarness harness;
  Caller who;
  std::map<std::uint8_t, std::uint64_t> last;
};

TEST_F(Ownership, ANodeOfADomainHasOneOwnerAndAConflictNamesIt) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  const auto conflict = open(2, {9, 3, 2});
  EXPECT_EQ(conflict.code(), Code::kNodeOwned);
  EXPECT_EQ(conflict.reply.status.node_ids, (Ids{2, 3}));
  EXPECT_NE(conflict.reply.status.text.find("session 01010101 (\"small_velocity_driven\")"), std::string::npos)
      << conflict.reply.status.text;
  EXPECT_EQ(open(3, {1, 2, 3}, "run 2").code(), Code::kOk) << "another domain";
  EXPECT_EQ(open(4, {1, 2, 3}, "").code(), Code::kOk) << "no domain";
  EXPECT_EQ(open(5, {1, 2, 3}, "").code(), Code::kOk);
  ASSERT_EQ(open(6, {4}).code(), Code::kOk);
  EXPECT_EQ(ask(6, wire::RegisterNodes{}, {5, 1}).code(), Code::kNodeOwned);
  EXPECT_EQ(ask(6, wire::RegisterNodes{}, {5, 4}).code(), Code::kDuplicateNode);
  EXPECT_EQ(ask(1, wire::CloseSession{}).code(), Code::kOk);
  EXPECT_EQ(ask(6, wire::RegisterNodes{}, {5, 1}).code(), Code::kOk) << "its owner has gone";
}

TEST_F(Ownership, ADomainIsOfWhoOpenedIt) {
  ASSERT_EQ(open(1, {1, 2}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {2}).code(), Code::kOk);
  who = {.identity = "uid 4711"};
  ASSERT_EQ(open(2, {1, 2}).code(), Code::kOk) << "another user's domain of the same name";
  EXPECT_EQ(ask(2, wire::AcceptNodes{transfer(1)}).code(), Code::kUnknownTransfer);
}

TEST_F(Ownership, RowsAreInTheOrderOfArrival) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(open(2, {3, 8, 7, 1}, "twin").code(), Code::kOk);
  EXPECT_EQ(std::get<wire::NodesChanged>(ask(1, wire::RetireNodes{}, {2, 1}).reply.body).nodes, 1u);
  EXPECT_EQ(std::get<wire::NodesChanged>(ask(1, wire::RegisterNodes{}, {8, 7, 1}).reply.body).nodes, 4u);
  for (int i = 0; i < 3; ++i) {
    const auto answer = step(1, {3, 8, 7, 1}, i);
    ASSERT_EQ(answer.code(), Code::kOk);
    EXPECT_EQ(answer.payload(), step(2, {3, 8, 7, 1}, i).payload()) << "as a session opened so";
  }
  EXPECT_EQ(ask(1, wire::RetireNodes{}, {2}).code(), Code::kUnknownNode);
  EXPECT_EQ(ask(1, wire::RetireNodes{}, {3, 3}).code(), Code::kDuplicateNode);
  EXPECT_EQ(ask(1, wire::RetireNodes{}).code(), Code::kShape);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {50}, {-3.0}).code(), Code::kInvalidValue);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {50}, {500.0}).code(), Code::kOk);
}

TEST_F(Ownership, WhatLeavesGivesItsMemoryBack) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  const std::uint64_t few = bytes();
  const Ids many = support::node_ids(5000);
  for (int round = 0; round < 3; ++round) {
    ASSERT_EQ(ask(1, wire::RegisterNodes{}, many).code(), Code::kOk);
    EXPECT_GT(bytes(), 500 * few);
    EXPECT_EQ(nodes(), 5003u);
    ASSERT_EQ(ask(1, wire::RetireNodes{}, many).code(), Code::kOk);
    EXPECT_EQ(bytes(), few);
    EXPECT_EQ(nodes(), 3u);
  }
}

TEST_F(Ownership, MemoryIsCheckedBeforeNodesAreMade) {
  ServiceHarness small(1, {.max_state_bytes = 1 << 20});
  small.ask(ServiceHarness::opening(support::velocity_scene(), Ids{1}));
  wire::Request request = ServiceHarness::in_session(wire::RegisterNodes{}, 1);
  request.batch = ServiceHarness::opening(support::velocity_scene(), support::node_ids(100'000)).batch;
  EXPECT_EQ(small.ask(request).code(), Code::kLimit);
  EXPECT_EQ(small.service.status().nodes, 1u);
}

TEST_F(Ownership, MovedNodesGoOnBitForBit) {
  ASSERT_EQ(open(1, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}).code(), Code::kOk);
  ASSERT_EQ(open(2, {}).code(), Code::kOk) << "with no node of its own";
  ASSERT_EQ(open(3, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}, "twin").code(), Code::kOk);
  const Ids all = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  for (int i = 0; i < 5; ++i) {
    step(1, all, i);
    step(3, all, i);
  }
  const std::uint64_t before = nodes();
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {9, 2, 4}).code(), Code::kOk);
  EXPECT_EQ(nodes(), before) << "on the way";
  EXPECT_EQ(step(1, all, 5).code(), Code::kShape) << "not the giver's any more";
  const auto conflict = ask(2, wire::RegisterNodes{}, {4});
  EXPECT_EQ(conflict.code(), Code::kNodeOwned) << "nor anybody's";
  EXPECT_NE(conflict.reply.status.text.find("session 01010101 offers it"), std::string::npos);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {4}).code(), Code::kNodeOwned) << "not anew the giver's either";
  const auto accepted = ask(2, wire::AcceptNodes{transfer(1)});
  ASSERT_EQ(accepted.code(), Code::kOk);
  EXPECT_EQ(ids_of(accepted), (Ids{9, 2, 4}));
  EXPECT_EQ(nodes(), before);
  for (int i = 5; i < 9; ++i) {
    const auto expected = temperatures(step(3, all, i));
    const Ids rest = {1, 3, 5, 6, 7, 8, 10};
    const auto kept = temperatures(step(1, rest, i));
    const auto moved = temperatures(step(2, {9, 2, 4}, i));
    ASSERT_EQ(kept.size(), rest.size());
    for (std::size_t row = 0; row < rest.size(); ++row) EXPECT_EQ(kept[row], expected[rest[row] - 1]);
    EXPECT_EQ(moved, (std::vector<double>{expected[8], expected[1], expected[3]}));
  }
}

TEST_F(Ownership, AnOfferIsTakenOnceByWhoShowsItsNumber) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(open(2, {4}).code(), Code::kOk);
  ASSERT_EQ(open(3, {5}, "elsewhere").code(), Code::kOk);
  ASSERT_EQ(open(4, {6}, "run 1", support::velocity_scene(12)).code(), Code::kOk);
  ASSERT_EQ(open(5, {7}, "").code(), Code::kOk);
  v1::Scene renamed = support::velocity_scene();
  renamed.set_name("the same layers");
  ASSERT_EQ(open(6, {8}, "run 1", renamed).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {2}).code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {3}).code(), Code::kInvalidValue) << "the number waits already";
  EXPECT_EQ(ask(1, wire::OfferNodes{}, {3}).code(), Code::kInvalidValue);
  EXPECT_EQ(ask(2, wire::AcceptNodes{transfer(9)}).code(), Code::kUnknownTransfer);
  EXPECT_EQ(ask(3, wire::AcceptNodes{transfer(1)}).code(), Code::kUnknownTransfer) << "another domain";
  EXPECT_EQ(ask(4, wire::AcceptNodes{transfer(1)}).code(), Code::kOtherScene);
  EXPECT_EQ(ask(5, wire::AcceptNodes{transfer(1)}).code(), Code::kUnsupported) << "no domain";
  EXPECT_EQ(ask(5, wire::OfferNodes{transfer(2)}, {7}).code(), Code::kUnsupported);
  const wire::Request accept = ServiceHarness::in_session(wire::AcceptNodes{transfer(1)}, last[6] + 1, 6);
  EXPECT_EQ(counted(6, harness.ask(accept)).code(), Code::kOk);
  const auto again = harness.ask(accept);
  EXPECT_TRUE(again.reply.replayed);
  EXPECT_EQ(ids_of(again), (Ids{2}));
  EXPECT_EQ(ask(2, wire::AcceptNodes{transfer(1)}).code(), Code::kUnknownTransfer) << "it was taken";
  EXPECT_EQ(nodes(), 8u);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {3}).code(), Code::kOk);
  EXPECT_EQ(ids_of(ask(1, wire::AcceptNodes{transfer(1)})), (Ids{3})) << "the giver takes them back";
}

TEST_F(Ownership, ATrialStandsInTheWay) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(open(2, {4}).code(), Code::kOk);
  ASSERT_EQ(ask(2, wire::OfferNodes{transfer(1)}, {4}).code(), Code::kOk);
  ASSERT_EQ(step(1, {1, 2, 3}, 0, Mode::kTrial).code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {9}).code(), Code::kTrialStands);
  EXPECT_EQ(ask(1, wire::RetireNodes{}, {1}).code(), Code::kTrialStands);
  EXPECT_EQ(ask(1, wire::OfferNodes{transfer(2)}, {1}).code(), Code::kTrialStands);
  EXPECT_EQ(ask(1, wire::AcceptNodes{transfer(1)}).code(), Code::kTrialStands);
  EXPECT_EQ(ask(1, wire::Commit{}).code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::AcceptNodes{transfer(1)}).code(), Code::kOk);
}

TEST_F(Ownership, AMarkBringsItsNodesBack) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(open(2, {4}).code(), Code::kOk);
  ASSERT_EQ(open(3, {1, 2, 3}, "twin").code(), Code::kOk);
  step(1, {1, 2, 3}, 0);
  step(3, {1, 2, 3}, 0);
  const std::uint64_t before = bytes();
  ASSERT_EQ(ask(1, wire::Mark{"dump"}).code(), Code::kOk);
  const std::uint64_t marked = bytes();
  EXPECT_GT(marked, before);
  ASSERT_EQ(ask(1, wire::RetireNodes{}, {1}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::RegisterNodes{}, {7}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {2, 7}).code(), Code::kOk);
  step(1, {3}, 1);
  const auto back = ask(1, wire::Rollback{"dump"});
  ASSERT_EQ(back.code(), Code::kOk) << back.reply.status.text;
  EXPECT_EQ(ids_of(back), (Ids{1, 2, 3}));
  EXPECT_EQ(bytes(), marked);
  EXPECT_EQ(nodes(), 7u);
  EXPECT_EQ(ask(2, wire::AcceptNodes{transfer(1)}).code(), Code::kUnknownTransfer) << "the offer was never made";
  EXPECT_EQ(temperatures(step(1, {1, 2, 3}, 1)), temperatures(step(3, {1, 2, 3}, 1)));

  // A rollback would take back node 2, which another session has accepted. The rollback is refused until that session
  // retires node 2.
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(2)}, {2}).code(), Code::kOk);
  ASSERT_EQ(ask(2, wire::AcceptNodes{transfer(2)}).code(), Code::kOk);
  const auto conflict = ask(1, wire::Rollback{"dump"});
  EXPECT_EQ(conflict.code(), Code::kNodeOwned);
  EXPECT_EQ(conflict.reply.status.node_ids, (Ids{2}));
  ASSERT_EQ(ask(2, wire::RetireNodes{}, {2}).code(), Code::kOk);
  EXPECT_EQ(ids_of(ask(1, wire::Rollback{"dump"})), (Ids{1, 2, 3}));
}

// A mark made while nodes are on offer does not contain these nodes. If the offer is then undone, a rollback to the
// mark would lose the nodes, so the mark is deleted with the offer.
TEST_F(Ownership, AMarkOfAnOfferThatWasUndoneIsGone) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::Mark{"before"}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {2}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::Mark{"during"}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::Rollback{"before"}).code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::Rollback{"during"}).code(), Code::kUnknownMark);
}

TEST_F(Ownership, TheLastSessionOfADomainTakesItsOffersAlong) {
  ASSERT_EQ(open(1, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(open(2, {}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::OfferNodes{transfer(1)}, {1, 2, 3}).code(), Code::kOk);
  ASSERT_EQ(ask(1, wire::CloseSession{}).code(), Code::kOk);
  EXPECT_EQ(nodes(), 3u) << "the giver may go: another session can accept";
  EXPECT_EQ(ask(2, wire::CloseSession{}).code(), Code::kOk);
  EXPECT_EQ(nodes(), 0u);
  EXPECT_EQ(bytes(), 0u);
}

TEST_F(Ownership, WithoutADomainASessionNeedsANode) {
  EXPECT_EQ(open(1, {}, "").code(), Code::kShape);
  EXPECT_EQ(open(1, {}, std::string(129, 'x')).code(), Code::kInvalidValue);
  ASSERT_EQ(open(1, {1}, "").code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {2}).code(), Code::kOk);
  EXPECT_EQ(ask(1, wire::RetireNodes{}, {1, 2}).code(), Code::kOk);
  EXPECT_EQ(nodes(), 0u);
  EXPECT_EQ(ask(1, wire::RegisterNodes{}, {1}).code(), Code::kOk);
  EXPECT_EQ(step(1, {1}, 0).code(), Code::kOk);
}

}  // namespace
}  // namespace shearbus::service
