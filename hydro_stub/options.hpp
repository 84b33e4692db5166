// The command line of shearbus-hydro.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "hydro_stub/hydro.pb.h"
#include "hydro_stub/restart.hpp"
#include "proto/wire/key_file.hpp"

namespace shearbus::hydro {

struct Options {
  std::filesystem::path scene;                       // this, or
  std::filesystem::path restart;                     // the directory of a run to go on with
  std::filesystem::path out;                         // empty: out/<scene name>-<interface law>
  wire::ServerAddress server;                        // no endpoint: in this process
  std::optional<guest::InterfaceLaw> interface_law;  // in place of the scene's
  DumpSchedule dumps;
  bool overlap = true;
  bool check = false;
  bool explain = false;
  bool plot = true;
  bool progress = true;
};

// The options, or the exit code where there is nothing (more) to do: --help, or a faulty command line. Parsing throws
// std::runtime_error for key files that cannot be used.
struct CommandLine {
  Options options;
  std::optional<int> exit_code;
};
CommandLine parse_command_line(int argc, char** argv);

}  // namespace shearbus::hydro
