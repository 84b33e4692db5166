// A function on a thread of its own that takes turns with its owner, as a coroutine does, and runs beside the owner
// where it says so.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace shearbus::shard {

class SideTask {
 public:
  // The function does not begin before its first turn. `wake` is called on the task's thread whenever the task wants
  // its turn. Throws std::system_error if there is no thread to be had.
  SideTask(std::function<void()> body, std::function<void()> wake);
  SideTask(const SideTask&) = delete;
  SideTask& operator=(const SideTask&) = delete;
  ~SideTask();  // a task that has not ended is unwound at the end of what it does aside

  // Called by the owner: gives the task its turn, after it has asked for it, and returns when the task runs aside or has
  // ended.
  void resume();
  bool wants_turn() const { return wants_turn_; }
  bool ended() const { return ended_; }

  // Called by the task in its turn: calls act() while the owner goes on, and returns in the task's next turn. Throws what
  // act() throws.
  void aside(const std::function<void()>& act);

 private:
  struct GivenUp {};  // unwinds a task that is not wanted any more

  void run(const std::function<void()>& body);
  void wait_for_turn();

  std::function<void()> wake_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool in_turn_ = false;
  bool given_up_ = false;
  std::atomic<bool> wants_turn_{false};
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace shearbus::shard
