#include <gtest/gtest.h>

#include "proto/program/progress.hpp"

namespace shearbus::program {
namespace {

TEST(Progress, SaysShareRateAndTimeLeft) {
  EXPECT_EQ(progress_line("replay", extent_of_steps(250, 1000, 2.5)),
            "replay  [#####...............]  25 %  250/1000 steps  100/s  7.5 s left");
  EXPECT_EQ(progress_line("replay", extent_of_steps(1000, 1000, 10)),
            "replay  [####################] 100 %  1000/1000 steps  100/s  0.0 s left");
}

TEST(Progress, NothingDoneYetHasNoTimeLeft) {
  EXPECT_EQ(progress_line("replay", extent_of_steps(0, 1000, 2)),
            "replay  [....................]   0 %  0/1000 steps  0/s  time left unknown");
}

TEST(Progress, OfARunThatEndsAtATimeCountsItsStepsAsSteps) {
  const TimeOfRun at{.begun_s = 0.0, .now_s = 3.55e-6, .end_s = 12e-6, .begun_step = 0, .step = 528};
  EXPECT_EQ(progress_line("cone", extent_of_time(at, 12.0)),
            "cone  [#####...............]  30 %  3.55 of 12 µs, step 528, 44 steps/s  29 s left");
  const TimeOfRun restarted{.begun_s = 2.0, .now_s = 3.0, .end_s = 4.0, .begun_step = 500, .step = 600};
  EXPECT_EQ(progress_line("tube", extent_of_time(restarted, 600.0)),
            "tube  [###############.....]  75 %  3 of 4 s, step 600, 0.167 steps/s  10 min left");
  const TimeOfRun begun{.begun_s = 0.0, .now_s = 0.0, .end_s = 0.5, .begun_step = 0, .step = 0};
  EXPECT_EQ(progress_line("tube", extent_of_time(begun, 2.0)),
            "tube  [....................]   0 %  0 of 500 ms, step 0, 0 steps/s  time left unknown");
}

// While the test captures standard error, it is no terminal, so progress must print nothing.
TEST(Progress, IsSilentWithoutATerminal) {
  testing::internal::CaptureStderr();
  {
    Progress progress("replay", true);
    progress.at(5, 10);
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace shearbus::program
