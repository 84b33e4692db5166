// Restart dumps of a run, in RUN/restart: dump-STEPS.h5, the newest two, as many as the subgrid service keeps marks.
// What a dump holds besides arrays of the run: the scene, where the server is, and what the interface law kept. The law
// keeps first, the dump is written after: a dump that is there can be gone on from.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include "proto/wire/dump.hpp"

namespace shearbus::hydro {

struct DumpSchedule {
  std::uint64_t every_steps = 0;  // 0: not by steps
  double interval_s = 0.0;        // of the clock on the wall; 0: not by time
  bool wanted() const { return every_steps > 0 || interval_s > 0.0; }
};

// A run that was told to stop and left a dump to go on from.
class Interrupted : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

std::filesystem::path restart_directory(const std::filesystem::path& run);
// Beside the dumps, made where it is not there: of a server in the process of the run.
std::filesystem::path server_directory(const std::filesystem::path& run);

// The newest dump of a run that is whole; says on stderr of damaged ones. Throws wire::Error where there is none.
wire::DumpReader newest_dump(const std::filesystem::path& run);

// Before a run begins anew. Throws wire::Error where it would spoil the dumps of another.
void make_room_for_dumps(const std::filesystem::path& run);

class RestartDumps {
 public:
  RestartDumps(std::filesystem::path run, const DumpSchedule& schedule) : run_(std::move(run)), schedule_(schedule) {}

  bool due(std::uint64_t steps) const;
  // `fill` is given the dump's name and its writer.
  void write(std::uint64_t steps, const std::function<void(const std::string&, wire::DumpWriter&)>& fill);
  void remove() const;  // the run is done

 private:
  std::filesystem::path run_;
  DumpSchedule schedule_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace shearbus::hydro
