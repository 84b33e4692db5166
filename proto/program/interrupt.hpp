// Handles SIGINT, SIGTERM and SIGHUP in programs that write files: the program finishes the present step and removes
// its partial files.
#pragma once

#include <csignal>

namespace shearbus::program {

namespace detail {
inline volatile std::sig_atomic_t interrupted = 0;
}

inline bool interrupted() {
  return detail::interrupted != 0;
}

// After this call the first signal sets interrupted(), and a second signal of the same kind ends the program at once.
inline void stop_at_next_step() {
  struct sigaction action = {};
  action.sa_handler = [](int) { detail::interrupted = 1; };
  sigemptyset(&action.sa_mask);
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup = {};
  sigaction(SIGHUP, nullptr, &hangup);
  // a signal that is ignored, as under nohup, stays ignored
  if (hangup.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
}

}  // namespace shearbus::program
