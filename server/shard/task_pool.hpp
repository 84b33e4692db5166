// Fork and join over a few threads that sleep between jobs. No other threads compute steps.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace shearbus::shard {

class TaskPool {
 public:
  // `threads` counts the caller of run(): a pool of 1 has no thread of its own; 0: one per core. Throws
  // std::system_error, which names the limit, if not all of the threads can be made.
  explicit TaskPool(unsigned threads);
  TaskPool(const TaskPool&) = delete;
  TaskPool& operator=(const TaskPool&) = delete;
  ~TaskPool();

  unsigned threads() const { return static_cast<unsigned>(workers_.size()) + 1; }

  using Task = std::function<void(std::size_t index)>;

  // Calls task(0), ..., task(count - 1) on the calling thread and at most `count - 1` others, in no defined order; returns
  // when every task is done. After the first exception of a task no further task starts, and run() throws that
  // exception. One caller at a time.
  void run(std::size_t count, const Task& task);

 private:
  void stop();
  void work();
  void take_tasks();

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable job_posted_;
  std::condition_variable job_left_;
  bool stopping_ = false;
  unsigned seats_ = 0;   // number of workers that may still join the job
  unsigned seated_ = 0;  // number of workers that have joined the job and not left it yet
  std::exception_ptr fault_;

  // The job: run() writes it before it offers seats, and the workers that have a seat read it.
  const Task* task_ = nullptr;
  std::size_t count_ = 0;
  std::atomic<std::size_t> next_{0};
};

// Makes one job at a time on a thread of its own, which lives as long as the job.
class Aside {
 public:
  Aside() = default;
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;
  ~Aside() { wait(); }

  // Starts a job, which must not throw, after the job before it has ended. Throws std::system_error if there is no
  // thread to be had.
  void start(std::function<void()> job);
  bool done() const { return done_; }               // whether the last job has ended
  void wait_for_end() const { done_.wait(false); }  // may be called on any thread
  void wait();

 private:
  std::thread thread_;
  std::atomic<bool> done_{true};
};

}  // namespace shearbus::shard
