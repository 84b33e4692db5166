// shearbus-ctl watch: shows what a server does, again and again. On a terminal it draws on the alternate screen, which
// the terminal replaces by what was there before when the program ends; anywhere else it prints a line for each look.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "client/ctl/operator.hpp"

namespace shearbus::ctl {

struct WatchOptions {
  std::string server;       // endpoint, as the user gave it
  double interval_s = 1.0;  // time between two looks
  bool json = false;        // a line of JSON for each look, also on a terminal
  std::uint64_t looks = 0;  // number of looks; 0: until a signal, or the key q
};

// Watches the server that connect() reaches until SIGINT, SIGTERM, SIGHUP or the screen's key q. One that does not answer
// is reported as that, and asked again at the next look. connect() throws Error if no server answers; it must return within
// about a second, because no signal is seen meanwhile. Returns whether the last look was answered.
bool watch(const WatchOptions& options, const std::function<Operator()>& connect);

}  // namespace shearbus::ctl
