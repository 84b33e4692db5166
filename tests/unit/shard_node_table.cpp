// Nodes join and leave a shard. The list of nodes must keep the order of arrival, the slots that hold their states must
// have no gaps, and every node must keep its states.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>

#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::shard {
namespace {

using Ids = std::vector<std::uint64_t>;

// A table and its map after some nodes have left.
struct Fewer {
  Fewer(const NodeTable& before, const Ids& leaving) {
    map.add(std::vector<std::uint32_t>(before.size(), 0), 1);
    change = map.remove(before.locate(leaving).slots);
    table = before.moved(change.slot_now);
  }
  TileMap map;
  TileMap::Change change;
  NodeTable table;
};

TEST(NodeTable, ThoseThatStayKeepTheirOrderAndNewOnesFollow) {
  Fewer left(NodeTable({5, 3, 900, 7, 1}), Ids{3, 1});
  const NodeTable& fewer = left.table;
  EXPECT_EQ(fewer.ids(), (Ids{5, 900, 7}));
  ASSERT_EQ(left.change.moves.size(), 1u);
  EXPECT_EQ(left.change.moves[0].from, 3u);  // node 7, in slot 3, moves into the free slot of node 3
  EXPECT_EQ(left.change.moves[0].to, 1u);
  EXPECT_FALSE(fewer.slots_are_rows());
  EXPECT_EQ(fewer.locate(Ids{7, 5, 900}).slots, (std::vector<std::uint32_t>{1, 0, 2}));
  const std::vector<std::uint32_t> slots = left.map.add(std::vector<std::uint32_t>{0, 0}, 1);
  EXPECT_EQ(slots, (std::vector<std::uint32_t>{3, 4}));
  EXPECT_EQ(fewer.with(Ids{3, 4}, slots).ids(), (Ids{5, 900, 7, 3, 4}));
  EXPECT_EQ(fewer.with(Ids{3, 4}, slots).locate(Ids{3, 4}).slots, slots);
  EXPECT_EQ(fewer.locate(Ids{3}).unknown, (Ids{3}));
}

TEST(NodeTable, WhoeverLeavesInTheEndLeavesRowsAndSlotsEqual) {
  const NodeTable table = NodeTable({5, 3, 900});
  EXPECT_TRUE(Fewer(table, Ids{900}).table.slots_are_rows());
  EXPECT_TRUE(Fewer(table, Ids{900, 3, 5}).table.slots_are_rows());
  EXPECT_EQ(Fewer(table, Ids{900, 3, 5}).table.size(), 0u);
}

TEST(NodeTable, CommonNodesAreFoundWhereverTheyStand) {
  const NodeTable table = NodeTable({50, 3, 900, 7});
  EXPECT_EQ(table.common(Ids{1, 3, 8, 50, 901}), (Ids{3, 50}));
  EXPECT_EQ(table.common(Ids{901, 902}), (Ids{}));
  EXPECT_EQ(table.common(Ids{0, 1}), (Ids{}));
  EXPECT_EQ(NodeTable().common(Ids{0, 1}), (Ids{}));
}

// Nodes join and leave one shard at random. For comparison each node also has a shard of its own, in which it stays.
// The bits of a node must be the same in both.
class Changing : public testing::TestWithParam<wire::Strategy> {
 protected:
  static constexpr double kDt = 1e-9;

  Shard make(const Ids& ids) {
    return Shard(physics::Model(service::scene_model(support::scene_of(GetParam())).options), ids,
                 std::vector<double>(ids.size(), 300.0), pool, {.nodes_per_task = 4});
  }
  std::vector<double> advance(Shard& shard, const Ids& ids, const Rows& rows, int step) {
    const wire::Batch batch = support::step_columns(GetParam(), ids, step);
    std::vector<double> temperature(ids.size()), stress(ids.size());
    wire::Batch no_reply;
    StepColumns columns = service::step_columns(batch, no_reply, kDt);
    columns.outputs = {AnswerColumn{&physics::TileOutputs::shear_stress, std::span(stress)},
                       AnswerColumn{&physics::TileOutputs::interface_temperature, std::span(temperature)}};
    shard.step(rows, *shard.operators(kDt), columns);
    shard.commit();
    temperature.insert(temperature.end(), stress.begin(), stress.end());
    return temperature;
  }

  TaskPool pool{2};
};
INSTANTIATE_TEST_SUITE_P(Strategies, Changing, support::both<wire::Strategy>(), support::name_of_strategy);

TEST_P(Changing, NoStateIsLostOrMixedUpWhoeverComesAndGoes) {
  std::mt19937 random(11);
  Ids ids = support::node_ids(30);
  std::uint64_t next_id = 1000;
  Shard shard = make(ids);
  std::map<std::uint64_t, std::unique_ptr<Shard>> alone;
  for (const std::uint64_t id : ids) alone.emplace(id, std::unique_ptr<Shard>(new Shard(make({id}))));
  const auto pick = [&](std::size_t count) {
    Ids picked = ids;
    std::ranges::shuffle(picked, random);
    picked.resize(std::min(count, picked.size()));
    return picked;
  };
  std::size_t most = 0;
  for (int step = 0; step < 120; ++step) {
    const auto kind = random() % 5;
    if (kind == 0) {
      Ids fresh(random() % 25 + 1);
      for (std::uint64_t& id : fresh) id = next_id++;
      shard.apply(shard.adding(fresh, std::vector<double>(fresh.size(), 300.0)));
      for (const std::uint64_t id : fresh) alone.emplace(id, std::unique_ptr<Shard>(new Shard(make({id}))));
      ids.insert(ids.end(), fresh.begin(), fresh.end());
    } else if (kind == 1) {
      const Ids leaving = pick(random() % 18 + 1);
      shard.apply(shard.removing(shard.nodes().locate(leaving).slots));
      for (const std::uint64_t id : leaving) {
        std::erase(ids, id);
        alone.erase(id);
      }
    } else if (kind == 2 && !ids.empty()) {  // some nodes leave the shard and join again with the states they had
      const Ids moving = pick(random() % 9 + 1);
      const Rows rows = shard.nodes().locate(moving);
      const States states = shard.states_of(rows.slots, false);
      shard.apply(shard.removing(rows.slots));
      shard.apply(shard.adding(moving, std::vector<double>(moving.size(), 300.0), &states));
      for (const std::uint64_t id : moving) std::erase(ids, id);
      ids.insert(ids.end(), moving.begin(), moving.end());
    }
    most = std::max(most, ids.size());
    ASSERT_EQ(shard.nodes().ids(), ids) << "step " << step;
    ASSERT_EQ(shard.state_bytes(), shard.bytes_for(ids.size()));
    if (ids.empty()) continue;
    const Ids asked = random() % 2 == 0 ? ids : pick(random() % ids.size() + 1);
    Rows rows;
    if (asked == ids)
      rows.all = true;
    else
      rows = shard.nodes().locate(asked);
    const auto answer = advance(shard, asked, rows, step);
    for (std::size_t row = 0; row < asked.size(); ++row) {
      Rows one;
      one.all = true;
      const auto expected = advance(*alone.at(asked[row]), {asked[row]}, one, step);
      ASSERT_EQ(answer[row], expected[0]) << "node " << asked[row] << " step " << step;
      ASSERT_EQ(answer[asked.size() + row], expected[1]) << "node " << asked[row] << " step " << step;
    }
  }
  EXPECT_GT(most, 40u);
}

// The shard grows and shrinks by so many nodes that its last block of states is replaced by a new one.
TEST_P(Changing, ManyNodesGrowAndShrinkBlockByBlock) {
  Ids ids = support::node_ids(700);
  Shard shard = make(ids);
  Rows all;
  all.all = true;
  advance(shard, ids, all, 0);
  Shard twin = make(ids);
  advance(twin, ids, all, 0);
  const Ids more = support::node_ids(900, 5000);
  shard.apply(shard.adding(more, std::vector<double>(more.size(), 400.0)));
  shard.apply(shard.removing(shard.nodes().locate(more).slots));
  EXPECT_EQ(shard.nodes().ids(), ids);
  EXPECT_EQ(shard.state_bytes(), twin.state_bytes());
  EXPECT_EQ(advance(shard, ids, all, 1), advance(twin, ids, all, 1));
}

TEST_P(Changing, AnAttemptChangesNothingUntilItIsTaken) {
  const Ids ids = support::node_ids(21);
  Shard shard = make(ids);
  Shard twin = make(ids);
  Rows all;
  all.all = true;
  const wire::Batch batch = support::step_columns(GetParam(), ids, 3);
  wire::Batch no_reply;
  const StepColumns columns = service::step_columns(batch, no_reply, kDt);
  const auto trial = [&](Shard& of) { of.step(all, *of.operators(kDt), columns); };
  const auto same = [](const States& a, const States& b) {
    for (std::size_t i = 0; i < a.columns.size(); ++i)
      if (a.columns[i].values != b.columns[i].values) return false;
    return a.rows == b.rows;
  };
  trial(shard);
  trial(twin);
  const auto operators = shard.operators(kDt);
  const auto attempt = shard.prepare_attempt(all, *operators, columns, true);
  shard.begin(*attempt);
  while (!shard.work(*attempt, 1.0)) {
  }
  EXPECT_TRUE(same(shard.committed_states(), twin.committed_states()));
  EXPECT_TRUE(same(shard.trial_states(), twin.trial_states()));
  shard.commit();
  shard.finish(*attempt);
  twin.commit();
  trial(twin);
  EXPECT_TRUE(same(shard.trial_states(), twin.trial_states()));
  shard.commit();
  twin.commit();
  EXPECT_TRUE(same(shard.committed_states(), twin.committed_states()));
}

}  // namespace
}  // namespace shearbus::shard
