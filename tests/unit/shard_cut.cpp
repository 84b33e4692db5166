// A cut holds the states of its moment, whatever the shard does before and while it is read.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <optional>
#include <random>
#include <thread>
#include <vector>

#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/cut.hpp"
#include "server/shard/shard.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::shard {
namespace {

constexpr double kDt = 1e-9;
constexpr std::size_t kNodes = 203;  // the last tile is not full

bool same(const States& a, const States& b) {
  if (a.rows != b.rows || a.columns.size() != b.columns.size()) return false;
  for (std::size_t i = 0; i < a.columns.size(); ++i) {
    const StateColumn &x = a.columns[i], &y = b.columns[i];
    if (x.name != y.name || x.units != y.units || x.width != y.width || x.values.size() != y.values.size() ||
        std::memcmp(x.values.data(), y.values.data(), x.values.size() * sizeof(double)) != 0)
      return false;
  }
  return true;
}

struct Host {
  Host(wire::Strategy of, unsigned threads)
      : strategy(of),
        pool(threads),
        shard(physics::Model(service::scene_model(support::scene_of(of)).options), support::node_ids(kNodes),
              std::vector<double>(kNodes, 300.0), pool, {.nodes_per_task = 16}) {}

  void trial(std::uint64_t step, const std::vector<std::uint64_t>& some = {}, bool apart = false) {
    const auto rows_ids = some.empty() ? shard.nodes().ids() : some;
    const wire::Batch batch = support::step_columns(strategy, rows_ids, static_cast<int>(step));
    Rows rows;
    if (some.empty())
      rows.all = true;
    else
      rows = shard.nodes().locate(some);
    std::vector<double> stress(rows_ids.size());
    wire::Batch no_reply;
    StepColumns columns = service::step_columns(batch, no_reply, kDt);
    columns.outputs = {AnswerColumn{&physics::TileOutputs::shear_stress, std::span(stress)}};
    if (!apart) {
      shard.step(rows, *shard.operators(kDt), columns);
      return;
    }
    const auto operators = shard.operators(kDt);
    const auto run = shard.prepare_attempt(rows, *operators, columns, false);
    shard.begin(*run);
    while (!shard.work(*run, 1.0)) {
    }
    shard.finish(*run);
  }

  wire::Strategy strategy;
  TaskPool pool;
  Shard shard;
};

struct Moment {
  explicit Moment(Shard& shard)
      : ids(shard.nodes().ids()),
        committed(shard.committed_states()),
        trial(shard.has_trial() ? std::optional(shard.trial_states()) : std::nullopt) {}
  std::vector<std::uint64_t> ids;
  States committed;
  std::optional<States> trial;
};

void expect_equal(const Cut::Contents& found, const Moment& moment) {
  EXPECT_EQ(found.node_ids, moment.ids);
  EXPECT_TRUE(same(found.committed, moment.committed));
  ASSERT_EQ(found.trial.has_value(), moment.trial.has_value());
  if (moment.trial) {
    EXPECT_TRUE(same(*found.trial, *moment.trial));
  }
}

// What a host may do, by number.
constexpr int kActs = 8;
void act(Host& host, int what, std::mt19937& random) {
  Shard& shard = host.shard;
  const auto some = [&] {
    std::vector<std::uint64_t> ids;
    for (const std::uint64_t id : shard.nodes().ids())
      if (random() % 7 == 0) ids.push_back(id);
    return ids;
  };
  const auto step = random() % 100;
  if (what == 0) host.trial(step);
  if (what == 1) host.trial(step, some());
  if (what == 2) host.trial(step, {}, true);
  if (what == 3 && shard.has_trial()) shard.commit();
  if (what == 4) shard.rollback();
  if (what < 5) return;
  shard.rollback();
  if (what == 5) shard.apply(shard.removing(shard.nodes().locate(some()).slots));
  if (what == 6) {
    const std::vector<std::uint64_t> ids = {1'000'000 + random(), 9'000'000'000 + random()};
    shard.apply(shard.adding(ids, std::vector<double>(ids.size(), 310.0)));
  }
  if (what == 7) {
    const States states = shard.committed_states();
    host.trial(step);
    shard.commit();
    shard.restore(states, nullptr, 3);
  }
}

TEST(Cut, HoldsItsMomentWhateverTheShardDoesBeforeItIsRead) {
  std::mt19937 random(1);
  for (const auto strategy : {wire::Strategy::kVelocityDriven, wire::Strategy::kForceDriven}) {
    Host host(strategy, 1);
    for (int round = 0; round < 60; ++round) {
      for (int i = 0; i < 3; ++i) act(host, static_cast<int>(random() % kActs), random);
      const Moment moment(host.shard);
      const auto cut = host.shard.cut();
      for (std::size_t i = random() % 6; i > 0; --i) act(host, static_cast<int>(random() % kActs), random);
      expect_equal(cut->read(), moment);
    }
  }
}

TEST(Cut, HoldsItsMomentWhileStepsRun) {
  std::mt19937 random(2);
  Host host(wire::Strategy::kVelocityDriven, 3);
  for (int round = 0; round < 40; ++round) {
    act(host, static_cast<int>(random() % kActs), random);
    const Moment moment(host.shard);
    auto cut = host.shard.cut();
    std::optional<Cut::Contents> found;
    std::thread reader([&] { found = std::exchange(cut, nullptr)->read(); });
    for (int i = 0; i < 6; ++i) act(host, static_cast<int>(random() % kActs), random);
    reader.join();
    expect_equal(*found, moment);
  }
}

TEST(Cut, OutlivesItsShardAndTheNextCut) {
  std::optional<Host> host;
  host.emplace(wire::Strategy::kForceDriven, 1);
  host->trial(1);
  const Moment first_moment(host->shard);
  const auto first = host->shard.cut();
  host->shard.commit();
  host->trial(2);
  const Moment second_moment(host->shard);
  const auto second = host->shard.cut();
  host->trial(3);
  host.reset();
  expect_equal(first->read(), first_moment);
  expect_equal(second->read(), second_moment);
}

}  // namespace
}  // namespace shearbus::shard
