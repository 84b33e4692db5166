// shearbus-replay HISTORY.h5 --scene SCENE.toml --out RESULT.h5: replays a recorded history (README.md in this
// directory).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <filesystem>

#include "client/replay/capsule.hpp"
#include "client/replay/replay.hpp"
#include "proto/wire/program.hpp"

namespace {

constexpr int kRunError = 1;  // exit code of a failed run, or if a failed step, repeated from its capsule, differs
constexpr int kUsageError = 2;

struct KeyFiles {
  std::filesystem::path server;
  std::filesystem::path own;
};

void describe(CLI::App& app, shearbus::replay::Options& options, KeyFiles& keys, std::filesystem::path& capsule,
              bool& explain) {
  app.set_version_flag("--version", options.version);
  app.add_option("HISTORY.h5", options.history, "the macroscopic history to replay")->type_name("");
  app.add_option("--scene", options.scene, "scene to replay it through")->type_name("SCENE.toml");
  app.add_option("--capsule", capsule,
                 "instead of a history: run the node of this failure capsule again, alone, and compare every column")
      ->type_name("FILE.h5");
  app.add_option("--out", options.out,
                 "HDF5 file for the answers; a file of that name is replaced once the run has succeeded")
      ->type_name("RESULT.h5");
  app.add_option("--server", options.server.endpoint,
                 "tcp://host:port or ipc://path of a server; none: one inside this process")
      ->type_name("ENDPOINT");
  app.add_option("--server-key", keys.server, "by tcp: file of the server's public key")->type_name("FILE");
  app.add_option("--key", keys.own, "by tcp: file of one's own secret key, from shearbus-ctl keygen")
      ->type_name("FILE");
  app.add_flag("--check", options.check, "read every value, compare with the scene, open a session; replay nothing");
  app.add_flag("--explain", explain,
               "with --scene alone: which parts of the model it switches on, what each costs on this machine");
  app.add_flag("--closed-loop", options.closed_loop,
               "force-driven: each reply's new jump is the next input, although the history records /velocity_jump");
  app.add_flag_callback(
      "--no-progress", [&options] { options.progress = false; }, "no progress line on the terminal");
  app.footer("What a history holds and how to make one: client/replay/README.md");
}

}  // namespace

int main(int argc, char** argv) {
  shearbus::wire::begin_program();
  shearbus::replay::Options options{.version = SHEARBUS_VERSION};
  CLI::App app("Replays a macroscopic history through the subgrid friction service.", "shearbus-replay");
  KeyFiles keys;
  std::filesystem::path capsule;
  bool explain = false;
  describe(app, options, keys, capsule, explain);
  try {
    app.parse(argc, argv);
    const bool has_history = !options.history.empty() || !options.scene.empty() || !options.out.empty();
    if (!capsule.empty() && has_history) throw CLI::ExcludesError("--capsule", "HISTORY.h5, --scene and --out");
    if (explain && options.scene.empty()) throw CLI::RequiredError("--scene");
    if (explain && !(options.history.empty() && options.out.empty() && capsule.empty()))
      throw CLI::ExcludesError("--explain", "HISTORY.h5, --out and --capsule");
    if (!explain && capsule.empty() && options.history.empty()) throw CLI::RequiredError("HISTORY.h5");
    if (!explain && capsule.empty() && options.scene.empty()) throw CLI::RequiredError("--scene");
    if (!explain && capsule.empty() && options.out.empty() && !options.check) throw CLI::RequiredError("--out");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }
  try {
    if (explain) {
      shearbus::replay::explain(options.scene);
      return shearbus::wire::end_program("shearbus-replay", 0);
    }
    if (!capsule.empty())
      return shearbus::wire::end_program("shearbus-replay", shearbus::replay::run_capsule(capsule) ? 0 : kRunError);
    shearbus::wire::read_keys_into(options.server, keys.server, keys.own);
    shearbus::replay::run(options);
    return shearbus::wire::end_program("shearbus-replay", 0);
  } catch (const std::exception& error) {
    shearbus::wire::complain(fmt::format("shearbus-replay: {}", error.what()));
    return kRunError;
  }
}
