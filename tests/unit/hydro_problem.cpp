// A scene of the hydrocode's shear column may give lists of values. Paired or combined, they make one column for each
// entry or for each combination.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "tests/support/refused.hpp"

namespace shearbus::hydro {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

guest::HydroScene scene_with(const std::string& lists) {
  return parse_scene(
             "name = \"lists\"\nstrategy = \"force_driven\"\n"
             "[soft]\nmaterial = \"aluminium_dlp\"\n[hard]\nmaterial = \"steel_dlp\"\n"
             "[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 200e6\n"
             "[hydro]\nend_time_s = 1e-7\n[hydro.shear_column]\nlength_m = 1e-3\nzones = 100\n" +
                 lists,
             "lists.toml")
      .scene;
}

TEST(HydroProblem, PairedListsMakeOneColumnPerEntry) {
  const ColumnProblem problem = make_problem(scene_with("velocity_jump_m_per_s = [10, 20]\npressure_pa = 1e9\n"));
  EXPECT_EQ(problem.columns, 2U);
  EXPECT_THAT(problem.initial_jump, ElementsAre(10.0, 20.0));
  EXPECT_THAT(problem.initial_temperature, ElementsAre(300.0, 300.0));
}

TEST(HydroProblem, CombinedListsMakeEveryCombination) {
  const ColumnProblem problem = make_problem(
      scene_with("lists = \"combined\"\nvelocity_jump_m_per_s = [10, 20]\ninitial_temperature_k = [300, 400]\n"
                 "pressure_pa = [1e9, 2e9, 3e9]\n"));
  EXPECT_EQ(problem.columns, 12U);
  EXPECT_THAT(problem.initial_jump, ElementsAre(10, 20, 10, 20, 10, 20, 10, 20, 10, 20, 10, 20));
  EXPECT_THAT(problem.initial_temperature, ElementsAre(300, 300, 400, 400, 300, 300, 400, 400, 300, 300, 400, 400));
  std::vector<double> pressure;
  for (std::size_t column = 0; column < problem.columns; ++column) pressure.push_back(problem.pressure.at(0.0, column));
  EXPECT_THAT(pressure, ElementsAre(1e9, 1e9, 1e9, 1e9, 2e9, 2e9, 2e9, 2e9, 3e9, 3e9, 3e9, 3e9));
}

TEST(HydroProblem, PairedListsOfOtherLengthsAndTooManyCombinationsAreRefused) {
  const auto fault_of = [](const std::string& lists) {
    return support::said_by<wire::Error>([&] { scene_with(lists); });
  };
  EXPECT_THAT(fault_of("velocity_jump_m_per_s = [10, 20, 30]\npressure_pa = [1e9, 2e9]\n"),
              HasSubstr("has 2 values, expected 1 or 3"));
  std::string jumps;
  std::string pressures;
  for (int i = 0; i < 2000; ++i) {
    jumps += "10,";
    pressures += "1e9,";
  }
  EXPECT_THAT(
      fault_of("lists = \"combined\"\nvelocity_jump_m_per_s = [" + jumps + "]\npressure_pa = [" + pressures + "]\n"),
      HasSubstr("combine to 4000000 columns, expected at most 2000000"));
}

}  // namespace
}  // namespace shearbus::hydro
