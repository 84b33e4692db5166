// Runs a two-dimensional problem and writes its results.
#pragma once

#include <filesystem>
#include <string>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/problem2d.hpp"
#include "hydro_stub/restart.hpp"
#include "hydro_stub/scene.hpp"
#include "proto/files/dump.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

struct RunOptions {
  std::filesystem::path out;
  bool progress = true;
  DumpSchedule dumps;
  server::Entries provenance;
  std::string server;  // endpoint of the subgrid server, stored in restart dumps for --restart
};

// Makes runs use one thread, unless OMP_NUM_THREADS says otherwise: where others use the processors, too, several gain
// nothing.
void choose_threads();

// Writes interface.h5 (histories of the interface nodes), free_surface.h5, fields.xmf with its directory, and
// summary.json to `options.out`, and prints the summary. `effective` is the scene with all constants filled in. If
// `from` is not null, the run continues from that dump. Throws Interrupted after SIGINT or SIGTERM, otherwise
// wire::Error or std::exception; a run that does not reach its end writes neither histories nor a summary.
void run_problem2d(const SceneFile& file, const guest::HydroScene& effective, Problem2d problem, InterfaceLaw& law,
                   const RunOptions& options, const files::DumpReader* from);

}  // namespace shearbus::hydro
