// shearbus-replay LOG...: sends the recorded requests again and compares the answers.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "proto/files/key_file.hpp"

namespace shearbus::replay {

struct LogReplayOptions {
  std::vector<std::filesystem::path> logs;  // event logs; a directory stands for all logs in it
  std::filesystem::path scene;              // replaces the recorded scene; empty: none
  std::vector<std::string> set;             // "table.key=value": changes of the scene
  bool swept = false;                       // the last of them is a value of --sweep
  std::string from_mark;                    // the changes hold from this mark on; empty: from the opening
  files::ServerAddress server;              // without an endpoint: a service inside this process
  std::filesystem::path out;                // .h5, .csv, a new event log or, for several logs, a directory; empty: none
  double rtol = 0.0;                        // largest relative difference of equal numbers; 0: equal bits
  bool progress = true;
  std::string version;
};

// Whether a path is an event log, or a directory that has some.
bool holds_event_logs(const std::filesystem::path& path);

// Checks the scenes of the logs with each of these changes by --sweep, unless a server is named, which may know laws of
// its own. Throws Error for the first that is at fault.
void check_sweep(const LogReplayOptions& options, std::span<const std::string> changes);

// Replays the logs in the order of their records and prints a summary. Without changes of the scene the answers are
// compared with the recorded ones, and the result tells whether they are equal. Throws Error.
bool replay_logs(const LogReplayOptions& options);

}  // namespace shearbus::replay
