#include "client/ctl/watch.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <optional>
#include <utility>

#include "client/ctl/watch_report.hpp"
#include "client/ctl/watch_screen.hpp"

namespace shearbus::ctl {
namespace {

using Clock = std::chrono::steady_clock;

// The signals that watch() reads from a descriptor. They are blocked while the object exists.
class Signals {
 public:
  Signals() {
    sigemptyset(&set_);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGTSTP, SIGWINCH}) sigaddset(&set_, signal);
    pthread_sigmask(SIG_BLOCK, &set_, &before_);
    file_ = ::signalfd(-1, &set_, SFD_CLOEXEC | SFD_NONBLOCK);
  }
  ~Signals() {
    ::close(file_);
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  int file() const { return file_; }
  int next() const {  // 0: none
    signalfd_siginfo info{};
    return ::read(file_, &info, sizeof info) == sizeof info ? static_cast<int>(info.ssi_signo) : 0;
  }
  // Stops the process as SIGTSTP does, and returns when it continues.
  static void stop() {
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, SIGTSTP);
    static_cast<void>(::raise(SIGTSTP));
    pthread_sigmask(SIG_UNBLOCK, &one, nullptr);  // here it takes effect
    pthread_sigmask(SIG_BLOCK, &one, nullptr);
  }

 private:
  sigset_t set_{};
  sigset_t before_{};
  int file_ = -1;
};

class Watch {
 public:
  Watch(const WatchOptions& options, const std::function<Operator()>& connect) : options_(options), connect_(connect) {
    if (!options.json && Screen::is_possible()) screen_.emplace();
  }

  // Returns whether the server answered the last look.
  bool run() {
    for (std::uint64_t n = 1;; ++n) {
      const Clock::time_point next = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                                        std::chrono::duration<double>(options_.interval_s));
      ask();
      show();
      if (n == options_.looks || !rest_until(next)) return sample_.has_value();
    }
  }

 private:
  void ask() {
    std::optional<Sample> before = std::exchange(sample_, std::nullopt);
    try {
      if (!server_) server_.emplace(connect_());
      Sample now{told_by(*server_)};
      if (now.is_operator) inspect_now_and_then(now, before);
      sample_ = std::move(now);
      report_ = report_of(*sample_, before);
    } catch (const Error& fault) {
      server_.reset();
      report_ = report_of(fault);
    }
  }

  // Sessions and hottest nodes are asked for so rarely that the server spends at most kInspecting of its time on them.
  void inspect_now_and_then(Sample& now, const std::optional<Sample>& before) {
    constexpr double kInspecting = 0.02;
    const Clock::time_point begun = Clock::now();
    if (before && begun < next_inspection_) {
      now.sessions = before->sessions;
      now.hottest = before->hottest;
      return;
    }
    inspect(*server_, now);
    const Clock::time_point ended = Clock::now();
    next_inspection_ = ended + std::chrono::duration_cast<Clock::duration>((ended - begun) / kInspecting);
  }

  void show() {
    if (screen_) return screen_->draw(options_, report_);
    fmt::print("{}\n", options_.json ? report_.line.dump(-1, ' ', false, Json::error_handler_t::replace)
                                     : printable(line_of(report_)));
    static_cast<void>(std::fflush(stdout));
  }

  // Returns false if the watch ends.
  bool rest_until(Clock::time_point next) {
    for (;;) {
      for (int signal = signals_.next(); signal != 0; signal = signals_.next())
        if (!handle(signal)) return false;
      // The keys are looked at also where the look took all of the time, as one without an answer does.
      const auto left =
          std::max<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(next - Clock::now()).count(), 0);
      std::array<pollfd, 2> files = {{{signals_.file(), POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}}};
      const bool keys = screen_ && screen_->has_keys();
      if (::poll(files.data(), keys ? 2 : 1, static_cast<int>(std::min<std::int64_t>(left, 3'600'000))) <= 0) {
        if (left == 0) return true;
        continue;
      }
      char key = 0;
      if (keys && files[1].revents != 0 && (::read(STDIN_FILENO, &key, 1) <= 0 || key == 'q')) return false;
    }
  }

  // Returns false if the signal ends the watch.
  bool handle(int signal) {
    if (signal == SIGTSTP) {
      if (screen_) screen_->leave();
      Signals::stop();
      if (screen_) screen_->enter();
    } else if (signal != SIGWINCH) {
      return false;
    }
    if (screen_) screen_->draw(options_, report_);
    return true;
  }

  const WatchOptions& options_;
  const std::function<Operator()>& connect_;
  Signals signals_;
  std::optional<Screen> screen_;
  std::optional<Operator> server_;
  std::optional<Sample> sample_;
  Report report_;
  Clock::time_point next_inspection_;
};

}  // namespace

bool watch(const WatchOptions& options, const std::function<Operator()>& connect) {
  return Watch(options, connect).run();
}

}  // namespace shearbus::ctl
