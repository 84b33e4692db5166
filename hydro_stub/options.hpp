// The command line of shearbus-hydro.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "hydro_stub/restart.hpp"
#include "proto/files/key_file.hpp"

namespace shearbus::hydro {

struct Options {
  std::span<const char* const> arguments;  // the command line
  std::filesystem::path scene;             // scene to run; empty if `restart` is given
  std::filesystem::path restart;           // directory of a run to continue; empty if `scene` is given
  std::filesystem::path out;               // directory for the results; empty: out/<scene name>-<interface law>
  files::ServerAddress server;             // subgrid server; without an endpoint it runs in this process
  std::string interface_law;               // name of the interface law in place of the scene's; empty: the scene's
  DumpSchedule dumps;
  bool overlap = true;
  bool check = false;
  bool explain = false;
  bool plot = true;
  bool progress = true;
};

// The result of parse_command_line(): the options, or an exit code after --help or a faulty command line.
// parse_command_line() throws std::runtime_error for encryption key files that cannot be used.
struct CommandLine {
  Options options;
  std::optional<int> exit_code;
};
CommandLine parse_command_line(int argc, char** argv);

}  // namespace shearbus::hydro
