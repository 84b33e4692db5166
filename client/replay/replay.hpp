// Sends a macroscopic history through the service step by step and records the answers.
#pragma once

#include <filesystem>
#include <string>

#include "proto/wire/key_file.hpp"

namespace shearbus::replay {

struct Options {
  std::filesystem::path history;
  std::filesystem::path scene;
  std::filesystem::path out;
  wire::ServerAddress server;  // no endpoint: a server inside this process
  bool check = false;          // read, compare and open a session; replay nothing
  bool closed_loop = false;    // force-driven: feed each new jump back even where /velocity_jump is recorded
  bool progress = true;
  std::string version;  // of this program, for the result's /meta
};

// Prints the cost of the scene's parts; does not replay.
void explain(const std::filesystem::path& scene);

// Replays the history and prints the summary. Throws shearbus::Error, and then leaves no result file.
void run(const Options& options);

}  // namespace shearbus::replay
