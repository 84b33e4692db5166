// The list of a node's states (server/physics/solver/states.hpp): in a tile they follow one another without a gap, and
// their names are those in checkpoints.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

using ::testing::ElementsAre;

std::vector<std::string> names_of(const ModelOptions& options) {
  const Model model(options);
  std::vector<std::string> names;
  for (const State& state : model.layout().states()) names.emplace_back(state.name);
  return names;
}

ModelOptions with_modes() {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.modes.emplace();
  options.tangential_components = 2;
  return options;
}

ModelOptions flowing_sleeper() {
  ModelOptions options = two_sided(graded(paper_options(Strategy::kForceDriven)));
  options.plastic_layer = true;
  options.sleep = true;
  return options;
}

ModelOptions with_inertia() {
  ModelOptions options = graded(paper_options());
  options.inertia = true;
  return options;
}

ModelOptions with_heated_layer() {
  ModelOptions options = two_sided(graded(paper_options()));
  options.taylor_quinney_factor = 0.9;
  return options;
}

TEST(PhysicsStates, RowsFollowOneAnotherAndFillTheTile) {
  for (const ModelOptions& options :
       {paper_options(), with_modes(), flowing_sleeper(), with_inertia(), with_heated_layer()}) {
    const Model model(options);
    std::size_t end = 0;
    std::set<std::string> names;
    for (const State& state : model.layout().states()) {
      EXPECT_EQ(state.offset, end) << state.name;
      EXPECT_GT(state.width, 0u) << state.name;
      EXPECT_TRUE(names.insert(state.name).second) << state.name << " stands twice";
      end += state.width * kLanes;
    }
    EXPECT_EQ(model.layout().doubles, end);
  }
}

// Checkpoints store states under these names (server/store/FORMAT.md lists them), so renaming a state makes old
// checkpoints unreadable.
TEST(PhysicsStates, HaveTheNamesOfCheckpoints) {
  EXPECT_THAT(names_of(with_modes()),
              ElementsAre("heat_modes_k", "temperature_k", "shear_stress_pa", "second_shear_stress_pa", "regime"));
  EXPECT_THAT(names_of(flowing_sleeper()),
              ElementsAre("hard_temperature_k", "temperature_k", "plastic_strain", "shear_stress_pa",
                          "shear_stress_rate_pa_per_s", "regime", "sticking", "resting", "hottest_at_rest_k",
                          "least_strain_at_rest"));
  EXPECT_THAT(names_of(with_inertia()),
              ElementsAre("temperature_k", "plastic_strain", "shear_stress_pa", "layer_velocity_m_per_s", "regime"));
  EXPECT_THAT(names_of(with_heated_layer()),
              ElementsAre("hard_temperature_k", "temperature_k", "plastic_strain", "heat_shape", "shear_stress_pa",
                          "shear_stress_rate_pa_per_s", "regime"));
  ModelOptions junctions = paper_options(Strategy::kForceDriven);
  junctions.junctions = JunctionOptions{0.5, 1e-6, junctions.soft};
  EXPECT_THAT(names_of(junctions), ElementsAre("temperature_k", "shear_stress_pa", "regime", "junction_strain"));
}

// An option costs the rows of its own states, and nothing where it is not chosen.
TEST(PhysicsStates, AnOptionAddsItsOwnRowsOnly) {
  constexpr std::size_t kVertices = 61, kCells = 60, kNone = TileLayout::kAbsent;
  const ModelOptions velocity = graded(paper_options()), force = graded(paper_options(Strategy::kForceDriven));
  ASSERT_EQ(Model(velocity).layout().doubles, (2 * kVertices + 3) * kLanes);  // T, ep; s, its rate, regime
  ASSERT_EQ(Model(force).layout().doubles, (kVertices + 2) * kLanes);         // T; s, regime
  EXPECT_EQ(Model(force).layout().plastic_strain, kNone);
  const std::size_t hard_vertices = Model(two_sided(velocity)).layout().num_hard_vertices;
  struct Case {
    const char* option;
    ModelOptions without;
    void (*choose)(ModelOptions&);
    std::size_t TileLayout::*state;  // where it stands, if it is chosen
    std::size_t rows;
  };
  for (const Case& c : {
           Case{"plastic layer", force, [](auto& o) { o.plastic_layer = true; }, &TileLayout::sticking,
                kVertices + 2},  // ep, sticking, rate of s
           Case{"junctions", force,
                [](auto& o) {
                  o.junctions = JunctionOptions{0.5, 1e-7, o.soft};
                },
                &TileLayout::junction_strain, 1},
           Case{"two components", velocity, [](auto& o) { o.tangential_components = 2; }, &TileLayout::second_stress,
                1},
           Case{"hard layer", velocity, [](auto& o) { o = two_sided(o); }, &TileLayout::hard_temperature,
                hard_vertices},
           Case{"plastic heating", two_sided(velocity), [](auto& o) { o.taylor_quinney_factor = 1.0; },
                &TileLayout::heat_shape, kVertices},
           Case{"inertia", velocity, [](auto& o) { o.inertia = true; }, &TileLayout::layer_velocity,
                2 * kCells - 1},  // s at every vertex, velocities; no rate of s
       }) {
    SCOPED_TRACE(c.option);
    ModelOptions with = c.without;
    c.choose(with);
    EXPECT_EQ(Model(c.without).layout().*c.state, kNone);
    EXPECT_NE(Model(with).layout().*c.state, kNone);
    EXPECT_EQ(Model(with).layout().doubles, Model(c.without).layout().doubles + c.rows * kLanes);
  }
  ModelOptions film = two_sided(force);
  film.melt_film = MeltFilmOptions{.latent_heat = 397e3, .viscosity = 1.25e-3, .activation_energy = 16.5e3};
  EXPECT_EQ(Model(two_sided(force)).layout().liquid_fraction, kNone);
  EXPECT_EQ(Model(film).layout().doubles,
            Model(two_sided(force)).layout().doubles + Model(film).layout().num_vertices * kLanes);
}

}  // namespace
}  // namespace shearbus::testing
