// shearbus-replay LOG...: sends the recorded requests again and compares the answers.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "client/replay/replay.hpp"

namespace shearbus::replay {

// Whether a path is an event log, or a directory that has some.
bool holds_event_logs(const std::filesystem::path& path);

// Checks the scenes of the logs with each of these changes by --sweep, unless a server is named, which may know laws of
// its own. Throws Error for the first that is at fault.
void check_sweep_of_logs(const Options& options, std::span<const std::string> changes);

// Replays the logs in the order of their records and prints a summary. Without changes of the scene the answers are
// compared with the recorded ones, and the result tells whether they are equal. Throws Error.
bool replay_logs(const Options& options);

}  // namespace shearbus::replay
