// A function that takes turns with its owner: only one of the two runs, except where the function says so.
#include "server/shard/side_task.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>

namespace shearbus::shard {
namespace {

TEST(SideTask, HasItsTurnAndGivesItUpForWhatItDoesAside) {
  std::string order;
  std::atomic<int> wakes{0};
  std::atomic<bool> go_on{false};
  SideTask* self = nullptr;
  SideTask task(
      [&] {
        order += "a";
        self->aside([&] {
          while (!go_on) std::this_thread::yield();
        });
        order += "c";
      },
      [&] { ++wakes; });
  self = &task;
  EXPECT_EQ(order, "");
  task.resume();
  EXPECT_EQ(order, "a");  // it is aside now, and does not touch the text before its next turn
  EXPECT_FALSE(task.ended());
  EXPECT_FALSE(task.wants_turn());
  order += "b";
  go_on = true;
  while (!task.wants_turn()) std::this_thread::yield();
  EXPECT_EQ(order, "ab");
  task.resume();
  EXPECT_EQ(order, "abc");
  EXPECT_TRUE(task.ended());
  EXPECT_EQ(wakes, 2);
  task.resume();  // does nothing
}

TEST(SideTask, AFaultAsideIsThrownInTheTurn) {
  std::string caught;
  SideTask* self = nullptr;
  SideTask task(
      [&] {
        try {
          self->aside([] { throw std::runtime_error("no memory"); });
        } catch (const std::runtime_error& fault) {
          caught = fault.what();
        }
      },
      [] {});
  self = &task;
  while (!task.ended()) task.resume();
  EXPECT_EQ(caught, "no memory");
}

TEST(SideTask, OneThatIsGivenUpIsUnwound) {
  struct Unwound {
    bool& flag;
    ~Unwound() { flag = true; }
  };
  bool unwound = false;
  bool went_on = false;
  {
    SideTask* self = nullptr;
    SideTask task(
        [&] {
          const Unwound mark{unwound};
          self->aside([] {});
          went_on = true;
        },
        [] {});
    self = &task;
    task.resume();
  }
  EXPECT_TRUE(unwound);
  EXPECT_FALSE(went_on);
  const SideTask never_begun([&] { went_on = true; }, [] {});
  EXPECT_FALSE(went_on);
}

}  // namespace
}  // namespace shearbus::shard
