#include "server/shard/side_task.hpp"

#include <exception>
#include <utility>

#include "proto/wire/host_process.hpp"

namespace shearbus::shard {

SideTask::SideTask(std::function<void()> body, std::function<void()> wake)
    : wake_(std::move(wake)), thread_(wire::own_thread([this, body = std::move(body)] { run(body); })) {}

SideTask::~SideTask() {
  {
    const std::lock_guard lock(mutex_);
    given_up_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void SideTask::run(const std::function<void()>& body) {
  try {
    wait_for_turn();
    body();
  } catch (const GivenUp&) {
  }
  const std::lock_guard lock(mutex_);
  ended_ = true;
  in_turn_ = false;
  changed_.notify_all();
}

void SideTask::resume() {
  std::unique_lock lock(mutex_);
  if (ended_) return;
  changed_.wait(lock, [this] { return wants_turn_.load(); });
  wants_turn_ = false;
  in_turn_ = true;
  changed_.notify_all();
  changed_.wait(lock, [this] { return !in_turn_; });
}

void SideTask::wait_for_turn() {
  {
    const std::lock_guard lock(mutex_);
    wants_turn_ = true;
    changed_.notify_all();
  }
  wake_();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return in_turn_ || given_up_; });
  if (!in_turn_) throw GivenUp();
}

void SideTask::aside(const std::function<void()>& act) {
  {
    const std::lock_guard lock(mutex_);
    in_turn_ = false;
    changed_.notify_all();
  }
  std::exception_ptr fault;
  try {
    act();
  } catch (...) {
    fault = std::current_exception();
  }
  wait_for_turn();
  if (fault) std::rethrow_exception(fault);
}

}  // namespace shearbus::shard
