// Warnings about inputs that were probably meant in another unit, or with the other sign of the pressure.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "client/src/input_check.hpp"

namespace shearbus {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

const std::vector<std::uint64_t> kNodes = {7, 8, 9};

Batch velocity_driven(double pressure, double jump) {
  Batch batch = Batch::of(std::array{Field::kVelocityJump, Field::kPressure}, 3);
  std::ranges::fill(batch.f64(Field::kVelocityJump), jump);
  std::ranges::copy(std::array{0.0, pressure, 0.5 * pressure}, batch.f64(Field::kPressure).begin());
  return batch;
}

Batch far_field(double jump, double stress) {
  Batch batch = Batch::of(std::array{Field::kVelocityJump, Field::kPressure, Field::kStressSoft, Field::kStressHard,
                                     Field::kMassSoft, Field::kMassHard},
                          2);
  std::ranges::fill(batch.f64(Field::kVelocityJump), jump);
  std::ranges::fill(batch.f64(Field::kPressure), 11.2e9);
  std::ranges::fill(batch.f64(Field::kStressSoft), stress);
  std::ranges::fill(batch.f64(Field::kMassSoft), 0.0135);
  std::ranges::fill(batch.f64(Field::kMassHard), 0.0395);
  return batch;
}

// The warnings of a run whose pressure in each step is pressure_of(step).
template <typename PressureOf>
std::vector<std::string> run(int steps, double jump, const PressureOf& pressure_of, double dt = 1e-9) {
  InputCheck check;
  std::vector<std::string> all;
  const auto take = [&](const std::vector<std::string>& some) { all.insert(all.end(), some.begin(), some.end()); };
  for (int step = 0; step < steps; ++step) take(check.add(velocity_driven(pressure_of(step), jump), dt, kNodes));
  take(check.end());
  return all;
}

TEST(InputCheck, NamesAPressureInAnotherUnit) {
  // 11.2 GPa and 0.4 GPa in Mbar, GPa, kbar, bar, MPa; and 100 GPa in bar.
  for (const double sent : {0.112, 11.2, 112.0, 11'200.0, 112'000.0, 0.004, 0.4, 4.0, 400.0, 4'000.0, 1e6}) {
    SCOPED_TRACE(sent);
    for (const int steps : {1, 5, 500})
      EXPECT_THAT(run(steps, 100.0, [&](int) { return sent; }),
                  ElementsAre(AllOf(StartsWith("pressure_pa: the highest pressure of the first"),
                                    HasSubstr("Is the pressure in pascal"))));
  }
  EXPECT_THAT(run(30, 100.0, [](int) { return 11'200.0; })[0],
              AllOf(HasSubstr("is 11200 Pa"), HasSubstr("jump is up to 100 m/s"),
                    HasSubstr("as MPa it would be 11.2 GPa"), HasSubstr("as bar it would be 1.12 GPa")));
}

TEST(InputCheck, ARealContactDrawsNoWarning) {
  EXPECT_THAT(run(500, 100.0, [](int) { return 11.2e9; }), IsEmpty());
  EXPECT_THAT(run(500, 100.0, [](int) { return 2e6; }), IsEmpty()) << "the lowest pressures of sliding";
  EXPECT_THAT(run(500, 0.5, [](int) { return 1e5; }), IsEmpty()) << "the air, at rest";
  EXPECT_THAT(run(500, 100.0, [](int step) { return 2e4 * (step + 1); }), IsEmpty()) << "pressed slowly";
  EXPECT_THAT(run(500, 100.0, [](int step) { return step < 200 ? 1e-5 : 4e8; }), IsEmpty())
      << "rounding before contact";
  EXPECT_THAT(run(500, 100.0, [](int) { return 0.0; }), IsEmpty()) << "bodies that never meet";
  EXPECT_THAT(run(500, 100.0, [](int) { return -1e-4; }), IsEmpty()) << "rounding at a free surface";
  EXPECT_THAT(run(500, 100.0, [](int step) { return step < 50 ? 3e9 : -5e8; }), IsEmpty()) << "contact, then tension";
  EXPECT_THAT(run(500, 100.0, [](int step) { return step < 50 ? -5e8 : 3e9; }), IsEmpty()) << "tension, then contact";
}

TEST(InputCheck, ARunThatIsAtRestFirstIsJudgedWhenItSlides) {
  InputCheck check;
  for (int step = 0; step < 50; ++step) EXPECT_THAT(check.add(velocity_driven(2'000.0, 0.0), 1e-9, kNodes), IsEmpty());
  std::vector<std::string> all;
  for (int step = 0; step < 50; ++step)
    for (const std::string& warning : check.add(velocity_driven(2'000.0, 50.0), 1e-9, kNodes)) all.push_back(warning);
  EXPECT_THAT(all, ElementsAre(HasSubstr("as MPa it would be 2 GPa")));
}

TEST(InputCheck, NamesAPressureOfTheWrongSign) {
  for (const int steps : {1, 500})
    EXPECT_THAT(run(steps, 100.0, [](int) { return -2e9; }),
                ElementsAre(AllOf(StartsWith("pressure_pa: no node was ever in contact"),
                                  HasSubstr("lowest pressure -2e+09 Pa"), HasSubstr("compression is positive"))));
  // Long before the end of the run, and counted from the first negative pressure.
  InputCheck check;
  int said_at = 0;
  for (int step = 1; step <= 400 && said_at == 0; ++step)
    if (!check.add(velocity_driven(step <= 200 ? 0.0 : -11'200.0, 0.0), 1e-9, kNodes).empty()) said_at = step;
  EXPECT_GE(said_at, 300);
  EXPECT_LE(said_at, 316) << "one step of 16 is looked at until something happens";
}

// Bodies that do not meet for long are not looked at in each step, but are once they do.
TEST(InputCheck, BodiesThatMeetLateAreJudged) {
  const auto from = [](double pressure) { return [pressure](int step) { return step < 5'000 ? 0.0 : pressure; }; };
  EXPECT_THAT(run(10'000, 100.0, from(11'200.0)), ElementsAre(HasSubstr("as MPa it would be 11.2 GPa")));
  EXPECT_THAT(run(10'000, 100.0, from(-11.2e9)), ElementsAre(HasSubstr("no node was ever in contact")));
  EXPECT_THAT(run(10'000, 100.0, from(11.2e9)), IsEmpty());
}

TEST(InputCheck, NamesALongFirstStepOnce) {
  EXPECT_THAT(run(
                  5, 100.0, [](int) { return 4e8; }, 1e-3),
              ElementsAre(StartsWith("dt_s: the first step is 0.001 s long")));
}

TEST(InputCheck, JudgesTheChangeOfTheJumpAndNotTheJump) {
  const auto first = [](const Batch& batch) { return InputCheck().add(batch, 1e-9, kNodes); };
  EXPECT_THAT(first(far_field(1001.0, 0.0)), IsEmpty()) << "a fast flyer";
  EXPECT_THAT(first(far_field(5000.0, 1e9)), IsEmpty());
  EXPECT_THAT(first(far_field(100.0, 1e11)),
              ElementsAre(StartsWith("mass_soft_kg_per_m2: without friction the jump of node 7 changes from 100 to ")));
  Batch stick =
      Batch::of(std::array{Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance}, 1);
  stick.f64(Field::kVelocityJump)[0] = 1500.0;
  stick.f64(Field::kPressure)[0] = 4e8;
  stick.f64(Field::kImpedance)[0] = 1e7;
  stick.f64(Field::kStickStress)[0] = 1500.0 * 1e7;
  EXPECT_THAT(first(stick), IsEmpty());
  stick.f64(Field::kStickStress)[0] = 2600.0 * 1e7;
  EXPECT_THAT(first(stick), ElementsAre(StartsWith("stick_stress_pa: without friction")));
}

TEST(InputCheck, NamesBodiesLighterThanMetals) {
  const auto far = [](double factor) {
    Batch batch = far_field(100.0, 0.0);
    for (const Field field : {Field::kMassSoft, Field::kMassHard})
      for (double& mass : batch.f64(field)) mass *= factor;
    InputCheck check;
    const auto found = check.add(batch, 1e-9, kNodes);
    EXPECT_EQ(check.doubts_units(), !found.empty());
    return found;
  };
  EXPECT_THAT(far(1.0), IsEmpty());
  EXPECT_THAT(far(1e-3), IsEmpty()) << "far below any zone, but not sure";
  EXPECT_THAT(far(1e-6), ElementsAre(AllOf(StartsWith("mass_soft_kg_per_m2: masses and dt_s of the first step"),
                                           HasSubstr("10.1 Pa s/m"), HasSubstr("per area, in kg/m2"))))
      << "of nodes of 1 mm2";
  Batch stick =
      Batch::of(std::array{Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance}, 1);
  stick.f64(Field::kVelocityJump)[0] = 100.0;
  stick.f64(Field::kPressure)[0] = 4e8;
  stick.f64(Field::kImpedance)[0] = 0.1;
  stick.f64(Field::kStickStress)[0] = 10.0;
  EXPECT_THAT(InputCheck().add(stick, 1e-9, kNodes),
              ElementsAre(AllOf(StartsWith("impedance_pa_s_per_m: the first step"), HasSubstr("Pa s/m and Pa"))));
}

TEST(InputCheck, AStepFarLongerThanAllBeforeItIsTold) {
  const auto warnings_of = [](std::vector<double> lengths) {
    InputCheck check;
    std::vector<std::string> all;
    for (const double dt : lengths)
      for (const std::string& warning : check.add(velocity_driven(1e9, 100.0), dt, kNodes)) all.push_back(warning);
    return all;
  };
  EXPECT_THAT(warnings_of({1e-9, 2e-9, 1e-3, 1e-9, 1e-3, 10.0}),
              ElementsAre("dt_s: a step of 0.001 s, after steps of at most 2e-09 s. Is dt_s in seconds, and this step "
                          "meant?"));
  EXPECT_THAT(warnings_of({1e-9, 1e-6, 5e-4, 1e-9, 1e-4}), IsEmpty());
}

}  // namespace
}  // namespace shearbus
