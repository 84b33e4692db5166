// Handles SIGINT, SIGTERM and SIGHUP in programs that write files: the program finishes the present step and removes
// its partial files.
#pragma once

#include <csignal>

namespace shearbus::program {

namespace detail {
inline volatile std::sig_atomic_t interrupts = 0, handled = 1;
}

inline bool interrupted() {
  return detail::interrupts > 0;
}
inline bool interrupted_again() {
  return detail::interrupts > 1;
}

// After this call the first `handled` signals set interrupted() and interrupted_again(), and one more of the same kind
// ends the program at once.
inline void stop_at_next_step(int handled = 1) {
  detail::handled = handled;
  struct sigaction action = {};
  action.sa_handler = [](int signal) {
    detail::interrupts = detail::interrupts + 1;
    if (detail::interrupts >= detail::handled) static_cast<void>(std::signal(signal, SIG_DFL));
  };
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup = {};
  sigaction(SIGHUP, nullptr, &hangup);
  // a signal that is ignored, as under nohup, stays ignored
  if (hangup.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
}

}  // namespace shearbus::program
