#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <vector>

#include "server/shard/task_pool.hpp"

namespace shearbus::shard {
namespace {

TEST(TaskPool, EveryIndexIsVisitedOnce) {
  for (unsigned threads : {1u, 2u, 4u}) {
    TaskPool pool(threads);
    for (std::size_t count : {0u, 1u, 2u, 7u, 1000u}) {
      std::vector<std::atomic<int>> visits(count);
      pool.run(count, [&](std::size_t index) { ++visits[index]; });
      for (std::size_t i = 0; i < count; ++i) ASSERT_EQ(visits[i], 1) << threads << " threads, index " << i;
    }
  }
}

TEST(TaskPool, ManyShortJobsInARowAllFinish) {
  TaskPool pool(4);
  std::atomic<std::size_t> sum{0};
  for (int job = 0; job < 5000; ++job) pool.run(8, [&](std::size_t) { ++sum; });
  EXPECT_EQ(sum, 5000u * 8u);
}

TEST(TaskPool, AFaultInATaskReachesTheCallerAndThePoolLivesOn) {
  for (const unsigned threads : {1u, 3u}) {
    TaskPool pool(threads);
    for (int round = 0; round < 100; ++round) {
      EXPECT_THROW(pool.run(100,
                            [](std::size_t index) {
                              if (index == 50) throw std::runtime_error("task 50");
                            }),
                   std::runtime_error);
      std::atomic<std::size_t> visited{0};
      pool.run(100, [&](std::size_t) { ++visited; });
      ASSERT_EQ(visited, 100u);
    }
  }
}

TEST(TaskPool, OneTaskRunsOnTheCallersThread) {
  TaskPool pool(4);
  const auto caller = std::this_thread::get_id();
  pool.run(1, [&](std::size_t) { EXPECT_EQ(std::this_thread::get_id(), caller); });
}

}  // namespace
}  // namespace shearbus::shard
