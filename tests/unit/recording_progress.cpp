#include <gtest/gtest.h>

#include "proto/wire/progress.hpp"

namespace shearbus::wire {
namespace {

TEST(Progress, SaysShareRateAndTimeLeft) {
  EXPECT_EQ(progress_line("replay", 250, 1000, 2.5),
            "replay  [#####...............]  25 %  250/1000 steps  100/s  7.5 s left");
  EXPECT_EQ(progress_line("replay", 1000, 1000, 10),
            "replay  [####################] 100 %  1000/1000 steps  100/s  0.0 s left");
}

TEST(Progress, NothingDoneYetHasNoTimeLeft) {
  EXPECT_EQ(progress_line("replay", 0, 1000, 2),
            "replay  [....................]   0 %  0/1000 steps  0/s  time left unknown");
}

// While the test captures standard error, it is no terminal, so progress must print nothing.
TEST(Progress, IsSilentWithoutATerminal) {
  testing::internal::CaptureStderr();
  {
    Progress progress("replay", 10, true);
    progress.at(5);
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace shearbus::wire
