// Shows a progress line of a long run, with the remaining time: on a terminal only, and only after two seconds.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <string>
#include <utility>

namespace shearbus::wire {

// Returns the text of a progress line:
//   replay  [#########...........]  45 %  450/1000 steps  812/s  0.7 s left
inline std::string progress_line(const std::string& what, std::size_t done, std::size_t total, double elapsed_s) {
  constexpr std::size_t kWidth = 20;
  const double fraction = total ? std::min(1.0, static_cast<double>(done) / static_cast<double>(total)) : 1.0;
  const auto filled = static_cast<std::size_t>(fraction * kWidth);
  const double rate = elapsed_s > 0 ? static_cast<double>(done) / elapsed_s : 0.0;
  const std::string left = rate > 0
                               ? fmt::format("{:.1f} s left", static_cast<double>(total - std::min(done, total)) / rate)
                               : "time left unknown";
  return fmt::format("{}  [{}{}] {:3.0f} %  {}/{} steps  {:.4g}/s  {}", what, std::string(filled, '#'),
                     std::string(kWidth - filled, '.'), 100 * fraction, done, total, rate, left);
}

class Progress {
 public:
  Progress(std::string what, std::size_t total, bool wanted)
      : what_(std::move(what)), total_(total), shown_(wanted && ::isatty(STDERR_FILENO) == 1) {}
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // Shows that `done` of the steps are done. Draws at most five times a second, so it may be called in every step.
  void at(std::size_t done) {
    if (!shown_) return;
    const auto now = Clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(200);
    const double elapsed_s = std::chrono::duration<double>(now - start_).count();
    fmt::print(stderr, "\r{}\033[K", progress_line(what_, done, total_, elapsed_s));
    drawn_ = true;
  }
  // Erases the line, so that later output starts on an empty line.
  void clear() {
    if (drawn_) fmt::print(stderr, "\r\033[K");
    drawn_ = false;
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::string what_;
  std::size_t total_;
  bool shown_;
  bool drawn_ = false;
  Clock::time_point start_ = Clock::now();
  Clock::time_point next_ = start_ + std::chrono::seconds(2);
};

}  // namespace shearbus::wire
