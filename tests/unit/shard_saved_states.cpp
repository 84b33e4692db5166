// What is saved of a shard is all there is: one restored from it goes on with the same bits, whatever the model keeps.
#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <vector>

#include "server/shard/shard.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::shard {
namespace {

using physics::ModelOptions;

constexpr std::size_t kNodes = 11;  // two tiles, the second in part

class SavedStates : public ::testing::TestWithParam<int> {
 protected:
  static ModelOptions options() {
    ModelOptions options = shearbus::testing::graded(shearbus::testing::paper_options());
    if (GetParam() == 1) options = shearbus::testing::two_sided(std::move(options));
    if (GetParam() == 2) {
      options = shearbus::testing::two_sided(std::move(options));
      options.taylor_quinney_factor = 0.9;
    }
    if (GetParam() == 3) {
      options.strategy = physics::Strategy::kForceDriven;
      options.interface = {0.3, 300e6};
      options.plastic_layer = true;
    }
    if (GetParam() == 4) {
      options.strategy = physics::Strategy::kForceDriven;
      options.junctions = {.contact_fraction = 0.5, .height = 1e-6, .metal = options.soft};
    }
    if (GetParam() == 5) options.inertia = true;
    if (GetParam() == 6) options.tangential_components = 2;
    if (GetParam() >= 7) {
      options.strategy = physics::Strategy::kForceDriven;
      options.interface = {0.3, 200e6};
      options.time_integrator = physics::TimeIntegrator::kSdirk2;
    }
    if (GetParam() == 8) options.modes.emplace();
    return options;
  }
};

Shard make_shard(const ModelOptions& options, TaskPool& pool) {
  std::vector<std::uint64_t> ids(kNodes);
  for (std::size_t i = 0; i < kNodes; ++i) ids[i] = i;
  return {physics::Model(options), ids, std::vector<double>(kNodes, 300.0), pool, ShardOptions{}};
}

// Both strategies are told all they may want. The far stresses hold the bodies near the layer's flow stress, so that
// some of them stick while it flows, which the stress alone does not tell.
std::vector<double> advance(Shard& shard, int steps) {
  std::vector<double> jump(kNodes), pressure(kNodes, 11.2e9), stress(kNodes), temperature(kNodes);
  std::vector<double> pull(kNodes), mass(kNodes, 2703 * 2.5e-6);
  for (std::size_t i = 0; i < kNodes; ++i) jump[i] = 40.0 + 30.0 * static_cast<double>(i);
  std::vector<double> across(kNodes);
  for (std::size_t i = 0; i < kNodes; ++i) across[i] = 50.0 - 12.0 * static_cast<double>(i);
  for (std::size_t i = 0; i < kNodes; ++i) pull[i] = 150e6 + 10e6 * static_cast<double>(i);
  Rows rows;
  rows.all = true;
  for (int step = 0; step < steps; ++step) {
    shard.step(rows, *shard.operators(1e-9),
               {.velocity_jump = jump,
                .second_velocity_jump = across,
                .pressure = pressure,
                .stress_minus = pull,
                .stress_plus = pull,
                .mass_minus = mass,
                .mass_plus = mass},
               {.shear_stress = stress, .interface_temperature = temperature});
    shard.commit();
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
}

std::string name_of(const ::testing::TestParamInfo<int>& model) {
  constexpr const char* kNames[] = {"OneSided", "TwoSided",      "PlasticWorkHeats", "PlasticLayer",  "Junctions",
                                    "Inertia",  "TwoComponents", "SecondOrder",      "WithoutProfile"};
  return kNames[model.param];
}
INSTANTIATE_TEST_SUITE_P(Models, SavedStates, ::testing::Range(0, 9), name_of);

}  // namespace
}  // namespace shearbus::shard
