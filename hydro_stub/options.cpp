#include "hydro_stub/options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "hydro_stub/scene.hpp"
#include "proto/program/command_line.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

namespace {

constexpr const char* kFooter = R"(Examples:
  shearbus-hydro hydro_stub/problems/shear_column_main.toml
  shearbus-hydro hydro_stub/problems/cone_al_steel.toml --interface-law coulomb_tresca --out out/cone
  shearbus-hydro scene.toml --explain

Exit codes: 0 done, 1 a fault, 2 a wrong command line, 3 interrupted (--restart continues the run).)";

}  // namespace

CommandLine parse_command_line(int argc, char** argv) {
  CommandLine line;
  Options& options = line.options;
  options.arguments = {argv, static_cast<std::size_t>(argc)};

  CLI::App app("Runs a scene's hydrodynamic problem and leaves histories, a summary and pictures.", "shearbus-hydro");
  CLI::Option* scene = app.add_option("SCENE", options.scene, "scene to run (TOML)");
  CLI::Option* restart =
      app.add_option("--restart", options.restart, "directory of a run that was stopped: go on from its last dump")
          ->type_name("DIR");
  app.add_option("--out", options.out, "directory for the results (default: out/NAME-LAW)")
      ->type_name("DIR")
      ->excludes(restart);
  app.add_option("--server", options.server.endpoint,
                 "endpoint of the subgrid server, tcp://HOST:PORT or ipc://PATH, or of several, with commas; each must "
                 "answer within 5 s (default: a server inside this process)")
      ->type_name("ENDPOINT");
  std::filesystem::path server_key;
  std::filesystem::path key;
  app.add_option("--server-key", server_key, "by tcp: file of the server's public key")->type_name("FILE");
  app.add_option("--key", key, "by tcp: file of one's own secret key, from shearbus-ctl keygen")->type_name("FILE");
  program::add_choice(app, "--interface-law", options.interface_law, interface_laws(),
                      "interface law in place of the scene's")
      ->excludes(restart);
  app.add_option("--dump-every", options.dumps.every_steps, "restart dump after every so many steps (default: none)");
  app.add_option("--dump-interval", options.dumps.interval_s,
                 "restart dump after every so many seconds (default: none)")
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--overlap,!--no-overlap", options.overlap,
               "in two dimensions, the thread that asks the law goes on with zones off the interface until it answers, "
               "as other threads do in either case (default: yes; same bits)");
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
  program::complete(app, "shearbus-hydro", server::version_text, kFooter);
  line.exit_code = program::parse(app, argc, argv, [&] {
    if (scene->empty() && restart->empty()) throw CLI::RequiredError("SCENE, or --restart DIR,");
    if (!scene->empty() && !restart->empty())
      throw CLI::ValidationError("SCENE and --restart DIR",
                                 "give one of them: the run of a directory goes on with the scene in its last dump");
    if (const std::string fault = files::fault_of_keys(options.server, server_key, key); !fault.empty())
      throw CLI::ValidationError(fault);
  });
  if (line.exit_code) return line;
  files::read_keys_into(options.server, server_key, key);
  return line;
}

}  // namespace shearbus::hydro
