// A step with absent_nodes = open: the nodes that it does not name are stepped as open contacts.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/support/service_harness.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

const std::vector<std::uint64_t> kNodes = support::node_ids(27);

std::vector<std::uint64_t> named_in(int step) {
  std::vector<std::uint64_t> ids;
  for (const std::uint64_t id : kNodes)
    if ((id + static_cast<std::uint64_t>(step)) % 3 == 0) ids.push_back(id);
  std::ranges::reverse(ids);
  return ids;
}

// Returns the columns of the nodes that the step names, followed by all other nodes with P = 0, jump 0 and no stress.
wire::Batch with_open_nodes(Strategy strategy, std::span<const std::uint64_t> nodes, int step) {
  std::vector<std::uint64_t> ids = named_in(step);
  const std::size_t named = ids.size();
  for (const std::uint64_t id : nodes)
    if (std::ranges::count(ids, id) == 0) ids.push_back(id);
  wire::Batch batch = support::step_columns(strategy, ids, step, true);
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && column.field != Field::kMassSoft && column.field != Field::kMassHard)
      for (std::size_t row = named; row < ids.size(); ++row) batch.f64(column.field)[row] = 0.0;
  return batch;
}

wire::Request step_of(std::uint64_t sequence, wire::Batch batch, std::uint8_t session, wire::AbsentNodes absent,
                      wire::Mode mode = wire::Mode::kAdvance, wire::Policy policy = wire::Policy::kAccept) {
  wire::Request request = ServiceHarness::step(sequence, std::move(batch), mode, session);
  auto& body = std::get<wire::Downscale>(request.body);
  body.absent_nodes = absent;
  body.policy = policy;
  return request;
}

class AbsentNodes : public testing::TestWithParam<Strategy> {
 protected:
  v1::Scene scene() const {
    v1::Scene scene = support::scene_of(GetParam());
    scene.mutable_layer()->set_initial_temperature_k(400.0);
    return scene;
  }
  // Returns the answer of all nodes to one more step. Sessions with equal states have equal answers.
  std::vector<std::byte> probe(ServiceHarness& harness, std::uint64_t sequence, std::uint8_t session,
                               std::span<const std::uint64_t> nodes) const {
    const Answer answer = harness.ask(
        ServiceHarness::step(sequence, support::step_columns(GetParam(), nodes, 99), wire::Mode::kAdvance, session));
    EXPECT_TRUE(answer.reply.status.ok()) << describe(answer.reply.status);
    return answer.payload();
  }
};
INSTANTIATE_TEST_SUITE_P(Strategies, AbsentNodes, support::both<Strategy>(), support::name_of_strategy);

TEST_P(AbsentNodes, OpenHasTheBitsOfNamingThemWithoutPressure) {
  for (const unsigned threads : {1U, 4U})
    for (const wire::Policy policy : {wire::Policy::kAccept, wire::Policy::kAllOrNothing}) {
      ServiceHarness harness(threads, {.nodes_per_task = 4});
      for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
        harness.granted(ServiceHarness::opening(scene(), kNodes, session));
      // Two nodes retire, so that the slot of a node in the shard differs from its row in a request.
      std::vector<std::uint64_t> nodes = kNodes;
      for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
        const std::vector<std::uint64_t> retiring = {kNodes[1], kNodes[4]};
        harness.granted(ServiceHarness::of_nodes(wire::RetireNodes{}, retiring, 1, session));
      }
      nodes.erase(nodes.begin() + 4);
      nodes.erase(nodes.begin() + 1);
      for (std::uint64_t sequence = 2; sequence <= 12; ++sequence) {
        const int step = 2 + 3 * static_cast<int>(sequence);  // a step that names none of the retired nodes
        const std::vector<std::uint64_t> ids = named_in(step);
        ASSERT_EQ(std::ranges::count(ids, kNodes[1]) + std::ranges::count(ids, kNodes[4]), 0);
        const Answer open = harness.ask(step_of(sequence, support::step_columns(GetParam(), ids, step, true), 1,
                                                wire::AbsentNodes::kOpen, wire::Mode::kAdvance, policy));
        const Answer named = harness.ask(step_of(sequence, with_open_nodes(GetParam(), nodes, step), 2,
                                                 wire::AbsentNodes::kKeep, wire::Mode::kAdvance, policy));
        ASSERT_TRUE(open.reply.status.ok()) << describe(open.reply.status);
        ASSERT_TRUE(named.reply.status.ok()) << describe(named.reply.status);
        EXPECT_EQ(std::get<wire::Upscale>(open.reply.body).nodes, ids.size());
        for (const wire::Column& column : open.reply.batch.columns())
          for (std::size_t row = 0; row < ids.size() && column.element == wire::Element::kFloat64; ++row)
            ASSERT_EQ(std::as_const(open.reply.batch).f64(column.field)[row],
                      std::as_const(named.reply.batch).f64(column.field)[row]);
      }
      EXPECT_EQ(probe(harness, 13, 1, nodes), probe(harness, 13, 2, nodes)) << "the states have the same bits";
    }
}

TEST_P(AbsentNodes, KeepIsTheDefaultAndDoesNotCool) {
  ServiceHarness harness;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
    harness.granted(ServiceHarness::opening(scene(), kNodes, session));
    harness.granted(
        ServiceHarness::step(1, support::step_columns(GetParam(), kNodes, 1), wire::Mode::kAdvance, session));
  }
  const std::vector<std::uint64_t> first = {kNodes[0]};
  for (std::uint64_t sequence = 2; sequence <= 5; ++sequence) {
    const wire::Batch batch = support::step_columns(GetParam(), first, 1, true);
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
      harness.granted(step_of(sequence, wire::Batch::over(batch.columns(), batch.bytes()), session,
                              session == 1 ? wire::AbsentNodes::kKeep : wire::AbsentNodes::kOpen));
  }
  const auto temperatures = [&](std::uint8_t session) {
    wire::Batch batch = support::step_columns(GetParam(), kNodes, 1);
    std::ranges::fill(batch.f64(Field::kPressure), 0.0);
    wire::Request request = ServiceHarness::step(6, std::move(batch), wire::Mode::kAdvance, session);
    std::get<wire::Downscale>(request.body).dt_s = 1e-18;  // too short for a change of the temperature
    const Answer answer = harness.ask(request);
    const auto column = std::as_const(answer.reply.batch).f64(Field::kInterfaceTemperature);
    return std::vector<double>(column.begin(), column.end());
  };
  const auto kept = temperatures(1), cooled = temperatures(2);
  int cooler = 0;
  for (std::size_t row = 1; row < kNodes.size(); ++row) cooler += cooled[row] < kept[row] - 0.1;
  EXPECT_NEAR(cooled[0], kept[0], 1e-9);
  EXPECT_GT(cooler, 10);
}

TEST_P(AbsentNodes, ATrialOfOpenNodesIsRolledBackWithTheOthers) {
  ServiceHarness harness;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
    harness.granted(ServiceHarness::opening(scene(), kNodes, session));
  const auto step = [&](std::uint64_t sequence, std::uint8_t session, int number, wire::Mode mode) {
    const Answer answer =
        harness.granted(step_of(sequence, support::step_columns(GetParam(), named_in(number), number, true), session,
                                wire::AbsentNodes::kOpen, mode));
  };
  step(1, 1, 1, wire::Mode::kAdvance);
  step(1, 2, 1, wire::Mode::kAdvance);
  step(2, 1, 2, wire::Mode::kTrial);
  harness.granted(ServiceHarness::in_session(wire::Rollback{}, 3, 1));
  step(4, 1, 5, wire::Mode::kTrial);
  harness.granted(ServiceHarness::in_session(wire::Commit{}, 5, 1));
  step(2, 2, 5, wire::Mode::kAdvance);
  EXPECT_EQ(probe(harness, 6, 1, kNodes), probe(harness, 3, 2, kNodes));
}

TEST_P(AbsentNodes, AStepWithoutRowsOpensAllNodes) {
  ServiceHarness harness;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
    harness.granted(ServiceHarness::opening(scene(), kNodes, session));
  const Answer none =
      harness.granted(step_of(1, support::step_columns(GetParam(), {}, 1, true), 1, wire::AbsentNodes::kOpen));
  wire::Batch all = support::step_columns(GetParam(), kNodes, 1);
  for (const wire::Column& column : all.columns())
    if (column.field != Field::kMassSoft && column.field != Field::kMassHard)
      std::ranges::fill(all.f64(column.field), 0.0);
  harness.granted(ServiceHarness::step(1, std::move(all), wire::Mode::kAdvance, 2));
  EXPECT_EQ(probe(harness, 2, 1, kNodes), probe(harness, 2, 2, kNodes));
  const Answer closed = harness.ask(ServiceHarness::in_session(wire::CloseSession{}, 3, 1));
  EXPECT_EQ(std::get<wire::SessionClosed>(closed.reply.body).node_steps, 2 * kNodes.size());
}

}  // namespace
}  // namespace shearbus::service
