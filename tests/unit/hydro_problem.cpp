// A scene of the hydrocode's shear column may give lists of values. Paired or combined, they make one column for each
// entry or for each combination.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "tests/support/refused.hpp"

namespace shearbus::hydro {
namespace {

using ::testing::Contains;
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

TEST(HydroProblem, NumbersInOtherUnitsAreAskedAndAStepIsNoLongerThanTheRun) {
  const std::string scene =
      "name = \"units\"\n[soft]\nmaterial = \"aluminium_dlp\"\n[hard]\nmaterial = "
      "\"steel_dlp\"\n"
      "[hydro]\nend_time_s = 12e-3\n";
  const auto warnings_of = [&](const std::string& text) { return parse_scene(scene + text, "u.toml").warnings(); };
  EXPECT_THAT(
      warnings_of("cone_target = {flyer_speed_m_per_s = 0.4, soft_eos = {tension_limit_pa = 1.2}}\n"),
      ElementsAre(
          HasSubstr("u.toml:7:1: warning: hydro.end_time_s = 0.012 s is unusual: values from 1e-09 to 0.001 s "),
          HasSubstr("hydro.cone_target.flyer_speed_m_per_s = 0.4 m s-1 is unusual"),
          HasSubstr("hydro.cone_target.soft_eos.tension_limit_pa = 1.2 Pa is unusual")));
  EXPECT_THAT(warnings_of("gas_flow = {test = \"noh\"}\n"), ElementsAre());
  EXPECT_THAT(warnings_of("interface_law = \"coulomb_tresca\"\ncoulomb_tresca = {friction_coefficient_fast = 0.5}\n"),
              Contains(HasSubstr("friction_coefficient_fast = 0.5 is above friction_coefficient_at_rest = 0.3")));
  guest::HydroScene column = scene_with("velocity_jump_m_per_s = 10\npressure_pa = 1e9\n");
  column.mutable_hydro()->mutable_shear_column()->set_length_m(1.0);
  EXPECT_THAT(support::said_by<wire::Error>([&] { make_problem(column); }),
              HasSubstr("end_time_s = 1e-07 s is shorter than one step of 3.1"));
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
