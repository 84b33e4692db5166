#include "server/shard/task_pool.hpp"

#include <algorithm>
#include <utility>

#include "proto/wire/host_process.hpp"

namespace shearbus::shard {

TaskPool::TaskPool(unsigned threads) {
  if (threads == 0) threads = std::max(1U, std::thread::hardware_concurrency());
  try {
    workers_.reserve(threads);
    for (unsigned i = 1; i < threads; ++i) workers_.push_back(wire::own_thread([this] { work(); }));
  } catch (...) {
    stop();
    throw;
  }
}

TaskPool::~TaskPool() {
  stop();
}

void TaskPool::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  job_posted_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void TaskPool::run(std::size_t count, const Task& task) {
  if (count == 0) return;
  const auto helpers = static_cast<unsigned>(std::min(workers_.size(), count - 1));
  {
    const std::lock_guard lock(mutex_);
    task_ = &task;
    count_ = count;
    next_ = 0;
    fault_ = nullptr;
    seats_ = helpers;
  }
  for (unsigned i = 0; i < helpers; ++i) job_posted_.notify_one();
  take_tasks();

  std::unique_lock lock(mutex_);
  seats_ = 0;  // a worker that wakes up after this can no longer join the job
  job_left_.wait(lock, [this] { return seated_ == 0; });
  if (fault_) std::rethrow_exception(std::exchange(fault_, nullptr));
}

void TaskPool::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    job_posted_.wait(lock, [this] { return stopping_ || seats_ > 0; });
    if (stopping_) return;
    --seats_;
    ++seated_;
    lock.unlock();
    take_tasks();
    lock.lock();
    if (--seated_ == 0) job_left_.notify_one();
  }
}

void Aside::start(std::function<void()> job) {
  wait();
  done_ = false;
  try {
    thread_ = wire::own_thread([this, job = std::move(job)] {
      job();
      done_ = true;
      done_.notify_all();
    });
  } catch (...) {
    done_ = true;
    throw;
  }
}

void Aside::wait() {
  if (thread_.joinable()) thread_.join();
}

void TaskPool::take_tasks() {
  try {
    for (std::size_t next = 0; (next = next_.fetch_add(1, std::memory_order_relaxed)) < count_;) (*task_)(next);
  } catch (...) {
    next_ = count_;
    const std::lock_guard lock(mutex_);
    if (!fault_) fault_ = std::current_exception();
  }
}

}  // namespace shearbus::shard
