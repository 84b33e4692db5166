#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::shard {
namespace {

using wire::Strategy;

constexpr double kDt = 1e-9;

struct Outputs {
  std::vector<double> stress, slip, temperature, jump, heat;
  std::vector<std::uint8_t> regime, outcome;

  explicit Outputs(std::size_t rows)
      : stress(rows), slip(rows), temperature(rows), jump(rows), heat(rows), regime(rows), outcome(rows) {}
  std::vector<OutputColumn> columns() {
    using physics::TileOutputs;
    return {AnswerColumn{&TileOutputs::shear_stress, std::span(stress)},
            AnswerColumn{&TileOutputs::sliding_velocity, std::span(slip)},
            AnswerColumn{&TileOutputs::interface_temperature, std::span(temperature)},
            AnswerColumn{&TileOutputs::velocity_jump_new, std::span(jump)},
            AnswerColumn{&TileOutputs::friction_heat, std::span(heat)},
            AnswerColumn{&TileOutputs::regime, std::span(regime)},
            AnswerColumn{&TileOutputs::outcome, std::span(outcome)}};
  }

  // Returns all outputs of one row of a batch as bytes.
  std::vector<std::uint8_t> row_bits(std::size_t row) const {
    std::vector<std::uint8_t> bits = {regime[row], outcome[row]};
    for (const double value : {stress[row], slip[row], temperature[row], jump[row], heat[row]}) {
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(&value);
      bits.insert(bits.end(), bytes, bytes + sizeof value);
    }
    return bits;
  }
};

class Fixture {
 public:
  Fixture(Strategy of, std::size_t nodes, unsigned threads = 1, std::size_t nodes_per_task = 512)
      : strategy(of),
        ids(support::node_ids(nodes)),
        pool(threads),
        shard(physics::Model(service::scene_model(support::scene_of(of)).options), ids,
              std::vector<double>(nodes, 300.0), pool, {.nodes_per_task = nodes_per_task}) {}

  // Steps the given nodes (all nodes if `some` is empty) and leaves the result as a trial.
  Outputs trial(int step, const std::vector<std::uint64_t>& some = {}) {
    const auto& rows_ids = some.empty() ? ids : some;
    const wire::Batch batch = support::step_columns(strategy, rows_ids, step);
    Rows rows;
    if (some.empty())
      rows.all = true;
    else
      rows = shard.nodes().locate(some);
    EXPECT_TRUE(rows.ok());
    Outputs outputs(rows_ids.size());
    wire::Batch no_reply;
    StepColumns columns = service::step_columns(batch, no_reply, kDt);
    columns.outputs = outputs.columns();
    shard.step(rows, *shard.operators(kDt), columns);
    return outputs;
  }
  Outputs advance(int step, const std::vector<std::uint64_t>& some = {}) {
    Outputs outputs = trial(step, some);
    shard.commit();
    return outputs;
  }

  std::vector<double> states() const {
    std::vector<double> all;
    for (std::size_t slot = 0; slot < ids.size(); slot += physics::kLanes) {
      const auto tile = shard.committed_tile(slot);
      all.insert(all.end(), tile.begin(), tile.end());
    }
    return all;
  }

  Strategy strategy;
  std::vector<std::uint64_t> ids;
  TaskPool pool;
  Shard shard;
};

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

void expect_same_rows(const Outputs& a, const Outputs& b) {
  ASSERT_EQ(a.stress.size(), b.stress.size());
  for (std::size_t row = 0; row < a.stress.size(); ++row) ASSERT_EQ(a.row_bits(row), b.row_bits(row)) << "row " << row;
}

class ShardOf : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, ShardOf, support::both<Strategy>(), support::name_of_strategy);

TEST_P(ShardOf, BitsDoNotDependOnThreadsOrOnHowWorkIsCut) {
  constexpr std::size_t kNodes = 203;
  Fixture alone(GetParam(), kNodes);
  std::vector<std::unique_ptr<Fixture>> others;
  for (const unsigned threads : {2u, 4u})
    for (const std::size_t nodes_per_task : {1u, 16u, 100u})
      others.push_back(std::make_unique<Fixture>(GetParam(), kNodes, threads, nodes_per_task));
  for (int step = 0; step < 15; ++step) {
    const Outputs expected = alone.advance(step);
    for (auto& other : others) expect_same_rows(other->advance(step), expected);
  }
  for (auto& other : others) EXPECT_TRUE(same_bits(other->states(), alone.states()));
}

TEST_P(ShardOf, NodesThatAreNotAskedKeepTheirBits) {
  Fixture f(GetParam(), 24);
  f.advance(0);
  const auto before = f.states();
  f.advance(1, {f.ids[9]});
  const auto after = f.states();
  const std::size_t doubles = f.shard.model().layout().doubles;
  std::size_t changed = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const std::size_t slot = i / doubles * physics::kLanes + i % physics::kLanes;
    const bool same = std::bit_cast<std::uint64_t>(before[i]) == std::bit_cast<std::uint64_t>(after[i]);
    if (slot == 9)
      changed += same ? 0 : 1;
    else
      ASSERT_TRUE(same) << "slot " << slot;
  }
  EXPECT_GT(changed, 0u);
}

TEST(Shard, UnknownAndDuplicateNodesAreNamedInRowOrder) {
  const NodeTable table({5, 3, 900, 7});
  const Rows rows = table.locate(std::vector<std::uint64_t>{3, 8, 900, 3, 1});
  EXPECT_FALSE(rows.ok());
  EXPECT_EQ(rows.unknown, (std::vector<std::uint64_t>{8, 1}));
  EXPECT_EQ(rows.duplicate, (std::vector<std::uint64_t>{3}));
  const Rows good = table.locate(std::vector<std::uint64_t>{900, 7, 5});
  EXPECT_TRUE(good.ok());
  EXPECT_EQ(good.slots, (std::vector<std::uint32_t>{2, 3, 0}));
  EXPECT_EQ(NodeTable::repeated(std::vector<std::uint64_t>{4, 9, 4, 9, 9, 2}), (std::vector<std::uint64_t>{4, 9}));
}

TEST(Shard, OperatorsAreMadeOncePerStepLength) {
  Fixture f(Strategy::kVelocityDriven, 8);
  const auto first = f.shard.operators(1e-9);
  EXPECT_EQ(f.shard.operators(1e-9), first);
  for (int i = 1; i < static_cast<int>(Shard::kOperatorsKept); ++i) {
    f.shard.operators(1e-9 * (i + 1));
    EXPECT_EQ(f.shard.operators(1e-9), first) << "in use, and forgotten after " << i << " others";
  }
  for (int i = 0; i < static_cast<int>(Shard::kOperatorsKept); ++i) f.shard.operators(1e-10 * (i + 1));
  EXPECT_NE(f.shard.operators(1e-9), first);
}

TEST(Shard, InitialTemperaturesGoToTheirOwnNodes) {
  TaskPool pool(1);
  const std::vector<double> temperatures = {300, 310, 320, 330, 340, 350, 360, 370, 380, 390};
  const Shard shard(physics::Model(service::scene_model(support::velocity_scene()).options), support::node_ids(10),
                    temperatures, pool);
  const auto& layout = shard.model().layout();
  for (std::size_t slot = 0; slot < temperatures.size(); ++slot)
    for (std::size_t vertex = 0; vertex < layout.num_vertices; ++vertex)
      ASSERT_EQ(shard.committed_tile(slot)[layout.temperature + vertex * physics::kLanes + slot % physics::kLanes],
                temperatures[slot]);
}

}  // namespace
}  // namespace shearbus::shard
