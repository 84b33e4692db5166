// Sends a macroscopic history (the inputs of the interface nodes, step by step) to the service, records the answers.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "client/replay/table.hpp"
#include "proto/files/key_file.hpp"

namespace shearbus::replay {

struct Options {
  std::vector<std::filesystem::path> inputs;  // a history; or event logs, a directory stands for all logs in it
  std::filesystem::path scene;                // of event logs: in place of the recorded one; empty: none
  // HDF5 or CSV; of event logs also a new log or, for several, a directory; empty: none
  std::filesystem::path out;
  TableOptions table;            // how to read and resample the history
  std::vector<std::string> set;  // "table.key=value": changes of the scene
  bool swept = false;            // the last of them is a value of --sweep
  files::ServerAddress server;   // without an endpoint: a server inside this process
  bool check = false;            // only check: read the history and open a session, but replay nothing
  bool closed_loop = false;      // force-driven: send back each answered jump, even if the history has /velocity_jump
  std::vector<std::uint64_t> profile_nodes;  // nodes whose profiles are recorded, in the group /profiles of the result
  std::vector<double> profile_times_s;       // times of these profiles
  bool progress = true;
  bool json = false;      // print the summary as one JSON object
  std::string from_mark;  // of an event log: the changes hold from this mark on; empty: from the opening
  double rtol = 0.0;      // of event logs: largest relative difference of equal numbers; 0: equal bits
  // Command line of this program, for the provenance in /meta of the result and in the JSON summary.
  std::span<const char* const> arguments;

  const std::filesystem::path& history() const { return inputs.front(); }
};

// Prints how much time and memory each part of the scene costs per node, without replaying a history.
void explain(const std::filesystem::path& scene);

// Opens and closes a session with each of these changes of the scene by --sweep. Throws shearbus::Error for the first
// that is refused.
void check_sweep(const Options& options, std::span<const std::string> changes);

// Replays the history and prints the summary. Throws shearbus::Error, in which case it leaves no result file.
void run(const Options& options);

}  // namespace shearbus::replay
