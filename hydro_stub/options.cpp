#include "hydro_stub/options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>

#include "hydro_stub/scene.hpp"
#include "proto/wire/program.hpp"

namespace shearbus::hydro {

CommandLine parse_command_line(int argc, char** argv) {
  CommandLine line;
  Options& options = line.options;
  guest::InterfaceLaw law = guest::INTERFACE_LAW_UNSPECIFIED;

  CLI::App app("Runs a scene's hydrodynamic problem and leaves histories, a summary and pictures.", "shearbus-hydro");
  CLI::Option* scene = app.add_option("scene", options.scene, "scene to run (TOML)");
  CLI::Option* restart =
      app.add_option("--restart", options.restart, "directory of a run that was stopped: go on from its last dump");
  app.add_option("--out", options.out, "directory for the results (default: out/NAME-LAW)")->excludes(restart);
  app.add_option(
      "--server", options.server.endpoint,
      "endpoint of the subgrid server, tcp://HOST:PORT or ipc://PATH, or of several, with commas (default: a server inside "
      "this process)");
  std::filesystem::path server_key;
  std::filesystem::path key;
  app.add_option("--server-key", server_key, "by tcp: file of the server's public key");
  app.add_option("--key", key, "by tcp: file of one's own secret key, from shearbus-ctl keygen");
  app.add_option("--interface-law", law,
                 "subgrid, coulomb_tresca, free_slip, stick or constant, in place of the scene's")
      ->transform(CLI::Transformer(
          std::map<std::string, guest::InterfaceLaw>{{"subgrid", guest::INTERFACE_LAW_SUBGRID},
                                                     {"coulomb_tresca", guest::INTERFACE_LAW_COULOMB_TRESCA},
                                                     {"free_slip", guest::INTERFACE_LAW_FREE_SLIP},
                                                     {"stick", guest::INTERFACE_LAW_STICK},
                                                     {"constant", guest::INTERFACE_LAW_CONSTANT}}))
      ->excludes(restart);
  app.add_option("--dump-every", options.dumps.every_steps, "restart dump after every so many steps (default: none)");
  app.add_option("--dump-interval", options.dumps.interval_s,
                 "restart dump after every so many seconds (default: none)")
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--overlap,!--no-overlap", options.overlap,
               "go on with zones off the interface while the law answers, in two dimensions (default: yes; same bits)");
  app.add_flag("--check", options.check, "check the scene, against the server too, and run nothing");
  app.add_flag("--explain", options.explain,
               "which parts of the subgrid model the scene switches on, what each costs on this machine; runs nothing");
  app.add_flag_callback(
      "--reference",
      [] {
        fmt::print("{}", reference());
        throw CLI::Success();
      },
      "print every key of a scene, as Markdown");
  app.add_flag("--plot,!--no-plot", options.plot, "draw pictures of the histories (default: yes)");
  app.add_flag("--progress,!--no-progress", options.progress,
               "show how far a long run is, on a terminal (default: yes)");
  try {
    app.parse(argc, argv);
    if (const std::string fault = wire::not_finite_in(app); !fault.empty()) throw CLI::ValidationError(fault);
    if (scene->empty() == restart->empty()) throw CLI::RequiredError("a scene, or --restart DIR");
  } catch (const CLI::ParseError& error) {
    line.exit_code = app.exit(error) == 0 ? 0 : 2;
    return line;
  }
  wire::read_keys_into(options.server, server_key, key);
  if (law != guest::INTERFACE_LAW_UNSPECIFIED) options.interface_law = law;
  return line;
}

}  // namespace shearbus::hydro
