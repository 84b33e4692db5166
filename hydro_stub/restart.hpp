// Restart dumps of a run: the newest two files RUN/restart/dump-STEPS.h5 are kept, as the subgrid service keeps the
// newest two saved states (marks) of a session. A dump holds the arrays of the run, the scene, the server's address and
// the saved state of the interface law. The law saves its state before the dump is written, so that a complete dump
// never refers to a state that was not saved.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include "proto/files/dump.hpp"

namespace shearbus::hydro {

struct DumpSchedule {
  std::uint64_t every_steps = 0;  // steps between dumps; 0: no dumps by number of steps
  double interval_s = 0.0;        // wall-clock time between dumps  [s]; 0: no dumps by time
  bool wanted() const { return every_steps > 0 || interval_s > 0.0; }
};

// Thrown by a run that was interrupted and wrote a dump to continue from.
class Interrupted : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

std::filesystem::path restart_directory(const std::filesystem::path& run);
// Returns the state directory of an embedded server, next to the dumps; creates the directory if it is missing.
std::filesystem::path server_directory(const std::filesystem::path& run);

// Returns the newest complete dump of a run; reports damaged dumps on stderr. Throws wire::Error if there is none.
files::DumpReader newest_dump(const std::filesystem::path& run);

// Says whether the results of a run with dumps are whole (note_end).
bool has_ended(const std::filesystem::path& run);

// Prepares the directory of a new run for its dumps. Throws wire::Error if dumps of a stopped run are there.
void make_room_for_dumps(const std::filesystem::path& run);

// Removes the results of a former run, of one or two dimensions: first the summary, without which no results look whole.
// Throws wire::Error, and then removes nothing, if one of their names is that of another file.
void remove_results(const std::filesystem::path& run);

class RestartDumps {
 public:
  RestartDumps(std::filesystem::path run, const DumpSchedule& schedule) : run_(std::move(run)), schedule_(schedule) {}

  bool due(std::uint64_t steps) const;
  // Writes a dump: calls `fill` with the name of the dump and the writer that takes its contents.
  void write(std::uint64_t steps, const std::function<void(const std::string&, files::DumpWriter&)>& fill);
  // Notes that the results are whole. From here on the session may be closed, and a restart only tidies up.
  void note_end() const;
  void remove() const;  // deletes the dumps after the end of the run

 private:
  std::filesystem::path run_;
  DumpSchedule schedule_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace shearbus::hydro
