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

namespace shearbus::program {

// How far a run is.
struct Extent {
  double fraction;   // of the whole run, 0 to 1
  std::string text;  // for example "450/1000 steps  812/s"
  double left_s;     // time that the rest will take  [s]; negative: unknown
};

// Returns the text of a progress line:
//   replay  [#########...........]  45 %  450/1000 steps  812/s  0.7 s left
inline std::string progress_line(const std::string& what, const Extent& extent) {
  constexpr std::size_t kWidth = 20;
  constexpr double kMinutesFrom = 180.0;
  const double fraction = std::clamp(extent.fraction, 0.0, 1.0);
  const auto filled = static_cast<std::size_t>(fraction * kWidth);
  const std::string left = extent.left_s < 0               ? "time left unknown"
                           : extent.left_s >= kMinutesFrom ? fmt::format("{:.0f} min left", extent.left_s / 60)
                           : extent.left_s >= 10           ? fmt::format("{:.0f} s left", extent.left_s)
                                                           : fmt::format("{:.1f} s left", extent.left_s);
  return fmt::format("{}  [{}{}] {:3.0f} %  {}  {}", what, std::string(filled, '#'), std::string(kWidth - filled, '.'),
                     100 * fraction, extent.text, left);
}

// The extent of a run whose number of steps is known.
inline Extent extent_of_steps(std::size_t done, std::size_t total, double elapsed_s) {
  const double rate = elapsed_s > 0 ? static_cast<double>(done) / elapsed_s : 0.0;
  return {.fraction = total ? static_cast<double>(done) / static_cast<double>(total) : 1.0,
          .text = fmt::format("{}/{} steps  {:.4g}/s", done, total, rate),
          .left_s = rate > 0 ? static_cast<double>(total - std::min(done, total)) / rate : -1.0};
}

// The extent of a run whose end is a time, since its number of steps is not known in advance:
//   3.55 of 12 µs, step 528, 44 steps/s
// `begun_s` and `begun_step`: where this process began, after a restart.
struct TimeOfRun {
  double begun_s, now_s, end_s;  // simulated time  [s]
  std::size_t begun_step, step;
};
inline Extent extent_of_time(const TimeOfRun& at, double elapsed_s) {
  const auto [unit, scale] = at.end_s < 1e-3  ? std::pair("µs", 1e6)
                             : at.end_s < 1.0 ? std::pair("ms", 1e3)
                                              : std::pair("s", 1.0);
  const double rate = elapsed_s > 0 ? static_cast<double>(at.step - at.begun_step) / elapsed_s : 0.0;
  const double done_s = at.now_s - at.begun_s;
  return {.fraction = at.end_s > 0 ? at.now_s / at.end_s : 1.0,
          .text = fmt::format("{:.3g} of {:.3g} {}, step {}, {:.3g} steps/s", scale * at.now_s, scale * at.end_s, unit,
                              at.step, rate),
          .left_s = done_s > 0 ? elapsed_s * (at.end_s - at.now_s) / done_s : -1.0};
}

class Progress {
 public:
  Progress(std::string what, bool wanted) : what_(std::move(what)), shown_(wanted && ::isatty(STDERR_FILENO) == 1) {}
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // Shows the extent that extent_of(elapsed_s) returns. Draws at most five times a second, so it may be called in every
  // step.
  template <typename ExtentOf>
  void show(const ExtentOf& extent_of) {
    if (!shown_) return;
    const auto now = Clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(200);
    const double elapsed_s = std::chrono::duration<double>(now - start_).count();
    fmt::print(stderr, "\r{}\033[K", progress_line(what_, extent_of(elapsed_s)));
    drawn_ = true;
  }
  // Shows that `done` of `total` steps are done.
  void at(std::size_t done, std::size_t total) {
    show([&](double elapsed_s) { return extent_of_steps(done, total, elapsed_s); });
  }
  // Erases the line, so that later output starts on an empty line.
  void clear() {
    if (drawn_) fmt::print(stderr, "\r\033[K");
    drawn_ = false;
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::string what_;
  bool shown_;
  bool drawn_ = false;
  Clock::time_point start_ = Clock::now();
  Clock::time_point next_ = start_ + std::chrono::seconds(2);
};

}  // namespace shearbus::program
