// The saved states of a shard are complete: a shard restored from them continues with the same bits, for every kind of
// state that a model may have.
#include <gtest/gtest.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/shard/shard.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::shard {
namespace {

using physics::ModelOptions;

constexpr std::size_t kNodes = 11;  // two tiles of 8 nodes, the second partly filled

constexpr physics::Strategy kVelocity = physics::Strategy::kVelocityDriven, kForce = physics::Strategy::kForceDriven;

void flow(ModelOptions& options) {
  options.interface = {0.3, 300e6};
  options.plastic_layer = true;
}
void be_of_second_order(ModelOptions& options) {
  options.interface = {0.3, 200e6};
  options.time_integrator = physics::TimeIntegrator::kSdirk2;
}

struct Kept {
  const char* name;
  physics::Strategy strategy;
  void (*choose)(ModelOptions&);
};
const Kept kModels[] = {
    {"OneSided", kVelocity, [](auto&) {}},
    {"TwoSided", kVelocity, [](auto& o) { o = shearbus::testing::two_sided(o); }},
    {"PlasticWorkHeats", kVelocity,
     [](auto& o) {
       o = shearbus::testing::two_sided(o);
       o.taylor_quinney_factor = 0.9;
     }},
    {"PlasticLayer", kForce, flow},
    {"Junctions", kForce, [](auto& o) { o.junctions = {.contact_fraction = 0.5, .height = 1e-6, .metal = o.soft}; }},
    {"Inertia", kVelocity, [](auto& o) { o.inertia = true; }},
    {"TwoComponents", kVelocity, [](auto& o) { o.tangential_components = 2; }},
    {"SecondOrder", kForce, be_of_second_order},
    {"WithoutProfile", kForce, [](auto& o) { be_of_second_order(o), o.modes.emplace(); }},
    {"Sleep", kForce, [](auto& o) { o.sleep = true; }},
    {"SleepDriven", kVelocity, [](auto& o) { o.sleep = true; }},
    {"SleepPlasticLayer", kForce, [](auto& o) { flow(o), o.sleep = true; }},
    {"ModesOfTwoComponents", kForce, [](auto& o) { o.modes.emplace(), o.tangential_components = 2; }},
};

class SavedStates : public ::testing::TestWithParam<Kept> {
 protected:
  static ModelOptions options() {
    ModelOptions options = shearbus::testing::graded(shearbus::testing::paper_options());
    options.strategy = GetParam().strategy;
    GetParam().choose(options);
    return options;
  }
};
INSTANTIATE_TEST_SUITE_P(Models, SavedStates, ::testing::ValuesIn(kModels),
                         [](const auto& model) { return model.param.name; });

Shard make_shard(const ModelOptions& options, TaskPool& pool) {
  std::vector<std::uint64_t> ids(kNodes);
  for (std::size_t i = 0; i < kNodes; ++i) ids[i] = i;
  return {physics::Model(options), ids, std::vector<double>(kNodes, 300.0), pool, ShardOptions{}};
}

// Steps all nodes with inputs for either strategy. The far stresses hold the bodies near the flow stress of the layer,
// so that some interfaces stick while their layer flows. Whether an interface sticks does not follow from its stress,
// so it must be a saved state of its own.
std::vector<double> advance(Shard& shard, int steps, bool commits = true) {
  std::vector<double> jump(kNodes), pressure(kNodes, 11.2e9), stress(kNodes), temperature(kNodes);
  std::vector<double> pull(kNodes), mass(kNodes, 2703 * 2.5e-6);
  for (std::size_t i = 0; i < kNodes; ++i) jump[i] = 40.0 + 30.0 * static_cast<double>(i);
  std::vector<double> across(kNodes);
  for (std::size_t i = 0; i < kNodes; ++i) across[i] = 50.0 - 12.0 * static_cast<double>(i);
  // If the call begins after step 30, every third node is an open contact (negative pressure).
  for (std::size_t i = 0; i < kNodes; i += 3) pressure[i] = shard.state_version() < 30 ? 11.2e9 : -1.0;
  for (std::size_t i = 0; i < kNodes; ++i) pull[i] = 150e6 + 10e6 * static_cast<double>(i);
  Rows rows;
  rows.all = true;
  for (int step = 0; step < steps; ++step) {
    using physics::TileInputs;
    using physics::TileOutputs;
    shard.step(rows, *shard.operators(1e-9),
               {.inputs = {{&TileInputs::velocity_jump, jump},
                           {&TileInputs::second_velocity_jump, across},
                           {&TileInputs::pressure, pressure},
                           {&TileInputs::stress_soft, pull},
                           {&TileInputs::stress_hard, pull},
                           {&TileInputs::mass_soft, mass},
                           {&TileInputs::mass_hard, mass}},
                .outputs = {AnswerColumn{&TileOutputs::shear_stress, std::span(stress)},
                            AnswerColumn{&TileOutputs::interface_temperature, std::span(temperature)}}});
    if (commits) shard.commit();
  }
  stress.insert(stress.end(), temperature.begin(), temperature.end());
  return stress;
}

TEST_P(SavedStates, ARestoredShardGoesOnWithTheSameBits) {
  TaskPool pool(1);
  Shard shard = make_shard(options(), pool);
  advance(shard, 200);
  Shard restored = make_shard(options(), pool);
  restored.restore(shard.committed_states(), nullptr, shard.state_version());
  const std::vector<double> expected = advance(shard, 50);
  const std::vector<double> found = advance(restored, 50);
  EXPECT_EQ(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(double)), 0);
  const States here = shard.committed_states(), there = restored.committed_states();
  for (std::size_t i = 0; i < here.columns.size(); ++i)
    EXPECT_EQ(there.columns[i].values, here.columns[i].values) << here.columns[i].name;
}

// States that were saved before a layer under force kept the rate of its stress are read; those that lack anything else
// are not.
TEST(SavedBefore, MayLackTheRateOfTheStressAlone) {
  TaskPool pool(1);
  ModelOptions options = shearbus::testing::graded(shearbus::testing::paper_options(physics::Strategy::kForceDriven));
  options.plastic_layer = true;
  options.interface.yield_strength = 400e6;
  Shard shard = make_shard(options, pool);
  advance(shard, 20);
  const auto without = [&](const std::string& name) {
    States states = shard.committed_states();
    EXPECT_EQ(std::erase_if(states.columns, [&](const StateColumn& column) { return column.name == name; }), 1) << name;
    return states;
  };
  const std::string rate = "shear_stress_rate_pa_per_s";
  Shard restored = make_shard(options, pool);
  restored.restore(without(rate), nullptr, shard.state_version());
  const States here = shard.committed_states(), there = restored.committed_states();
  for (std::size_t i = 0; i < here.columns.size(); ++i) {
    const bool lost = here.columns[i].name == rate;
    EXPECT_EQ(there.columns[i].values == here.columns[i].values, !lost) << here.columns[i].name;
    if (lost) {
      EXPECT_EQ(there.columns[i].values, std::vector<double>(kNodes, 0.0));
    } else {
      EXPECT_THROW(restored.restore(without(here.columns[i].name), nullptr, shard.state_version()),
                   std::invalid_argument);
    }
  }
}

// A shard takes over four nodes of the shard `giver`, with all their states. Afterwards a trial of `giver` is rolled
// back and must leave no trace.
TEST(SavedModes, GoWithTheirNodes) {
  TaskPool pool(1);
  ModelOptions options = shearbus::testing::graded(shearbus::testing::paper_options(physics::Strategy::kForceDriven));
  options.modes.emplace();
  Shard stayed = make_shard(options, pool), giver = make_shard(options, pool);
  Shard taker(physics::Model(options), std::vector<std::uint64_t>{100}, std::vector<double>{300.0}, pool);
  advance(stayed, 60);
  advance(giver, 60);
  const auto values_of = [](const Shard& shard, std::uint32_t slot) {
    std::vector<double> all;
    for (const StateColumn& column : shard.states_of(std::vector{slot}, false).columns)
      all.insert(all.end(), column.values.begin(), column.values.end());
    return all;
  };
  // 1. Register four nodes with the shard `taker`, with copies of the states that they have in the shard `giver`.
  const std::vector<std::uint32_t> slots = {2, 5, 7, 10};
  const std::vector<std::uint64_t> ids(slots.begin(), slots.end());
  const States moving = giver.states_of(slots, false);
  taker.apply(taker.adding(ids, std::vector<double>(ids.size(), 300.0), &moving));
  for (std::uint32_t i = 0; i < slots.size(); ++i) EXPECT_EQ(values_of(taker, i + 1), values_of(stayed, slots[i]));
  // 2. Roll back a trial in the shard `giver`.
  advance(giver, 1, false);
  giver.rollback();
  advance(giver, 20);
  advance(stayed, 20);
  for (std::uint32_t slot = 0; slot < kNodes; ++slot) EXPECT_EQ(values_of(giver, slot), values_of(stayed, slot));
}

}  // namespace
}  // namespace shearbus::shard
