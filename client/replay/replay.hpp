// A macroscopic history sent through the service, step by step, and what came back.
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

// Prints what the scene pays for, and replays nothing.
void explain(const std::filesystem::path& scene);

// Prints the summary. Throws shearbus::Error; no result is left behind then.
void run(const Options& options);

}  // namespace shearbus::replay
