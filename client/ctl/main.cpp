// shearbus-ctl: operates a running server, checks scenes, compares checkpoints, makes keys.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/ctl/operations.hpp"
#include "client/include/shearbus/client.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/key_file.hpp"
#include "server/embedded.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/options_page.hpp"
#include "server/store/compare.hpp"

namespace {

constexpr int kExitFault = 1;
constexpr int kExitUsage = 2;
constexpr double kPingTimeoutS = 0.9;

struct Options {
  std::string server;
  std::filesystem::path server_key;
  std::filesystem::path key;
  double timeout_s = 5.0;
  bool json = false;
  std::filesystem::path scene;
  std::string session;
  shearbus::wire::Top top = shearbus::wire::Top::kHottest;
  std::uint32_t count = 10;
  bool exit = false;
  double idle_s = 60.0;
  std::vector<std::filesystem::path> checkpoints;
  std::string key_name;
  bool key_of_operator = false;
  std::string material;
};

shearbus::Client connect(const Options& options) {
  const auto deadline = std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options.timeout_s));
  shearbus::wire::ServerAddress server{.endpoint = options.server};
  read_keys_into(server, options.server_key, options.key);
  return shearbus::Client({.endpoint = server.endpoint,
                           .server_key = server.server_key,
                           .secret_key = server.secret_key,
                           .name = "shearbus-ctl",
                           .connect_deadline = deadline,
                           .reply_deadline = deadline});
}

void ping(const Options& options) {
  const auto started = std::chrono::steady_clock::now();
  const shearbus::Client client = connect(options);
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - started;
  shearbus::ctl::show_ping(client, options.server, took.count());
}

// Returns 0 for equal checkpoints, otherwise 1, as diff does.
int compare(const Options& options) {
  const std::string text = shearbus::store::first_difference(options.checkpoints[0], options.checkpoints[1]);
  fmt::print("{}\n", text.empty() ? "the same states" : text);
  return text.empty() ? 0 : kExitFault;
}

// Opens a session of the scene in a server of this process, which checks schema and materials.
void check(const Options& options) {
  const std::string file = options.scene.string();
  const shearbus::server::Embedded server;
  shearbus::Client client({.endpoint = server.endpoint(), .context = server.context(), .name = "shearbus-ctl"});
  const std::array<std::uint64_t, 1> node = {0};
  shearbus::Session session = client.open(shearbus::scene::load_text(options.scene), file, node);
  fmt::print("{}", session.effective_scene());
  for (const std::string& warning : session.warnings()) fmt::print(stderr, "{}: warning: {}\n", file, warning);
  fmt::print(stderr, "{}: valid; {} bytes of state per node\n", file, session.bytes_per_node());
  session.close();
}

// Writes a key pair; the public file is a line for a server's --authorized-keys.
void keygen(const Options& options) {
  const shearbus::KeyPair pair = shearbus::make_key_pair();
  const std::filesystem::path secret_file = options.key_name + ".secret";
  const std::filesystem::path public_file = options.key_name + ".public";
  if (std::filesystem::exists(public_file))  // before a secret key without it is left behind
    throw std::runtime_error(public_file.string() + ": exists already, and keys are never written over");
  shearbus::wire::write_secret_key(secret_file, pair.secret_key);
  const std::string name = std::filesystem::path(options.key_name).filename().string();
  shearbus::wire::write_public_key(
      public_file, {.key = pair.public_key, .words = (options.key_of_operator ? "operator " : "") + name});
  fmt::print("{}: keep it where only its user can read it\n{}: {}\n", secret_file.string(), public_file.string(),
             pair.public_key);
}

// Prints the materials of the catalog, or one of them with its constants under their scene keys.
void materials(const Options& options) {
  for (const auto& entry : shearbus::physics::catalog()) {
    if (!options.material.empty() && options.material != entry.name) continue;
    fmt::print("{}\n  {}\n", entry.name, entry.source);
    if (options.material.empty()) continue;
    fmt::print("  flow_law = \"{}\"\n", shearbus::physics::FlowLaws::name_of(entry.material.flow_law));
    for (const auto& [name, value] : constants_of(entry.material)) fmt::print("  {} = {:.15g}\n", name, value);
  }
  if (options.material.empty()) {
    fmt::print("Numbers for which one source is named have been compared with no other.\n");
    return;
  }
  // An unknown name is reported with the message that a scene would get.
  const auto known = shearbus::physics::make_material(options.material, {});
  if (!known.fault.empty()) throw std::runtime_error(known.fault);
}

void reference() {
  fmt::print("{}", shearbus::scene::reference_of(*shearbus::v1::Scene::descriptor()));
}

void options_page() {
  fmt::print("{}", shearbus::physics::options_page());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Questions to a running shearbus server, and about scenes."};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("shearbus-ctl ") + SHEARBUS_VERSION);
  Options options;
  std::function<void()> run;
  int exit_code = 0;

  const auto needs_server = [&](CLI::App* command) {
    command->add_option("--server", options.server, "Where the server listens, e.g. ipc:///run/user/1000/shearbus/bus")
        ->type_name("ENDPOINT")
        ->required();
    command->add_option("--server-key", options.server_key, "By tcp: file of the server's public key")
        ->type_name("FILE");
    command->add_option("--key", options.key, "By tcp: file of one's own secret key")->type_name("FILE");
    command->add_option("--timeout", options.timeout_s, "How long to wait for an answer, in seconds")
        ->check(CLI::Range(1e-3, 1e6))
        ->capture_default_str();
    return command;
  };
  auto* ping_command = needs_server(app.add_subcommand("ping", "Is a server there? For probes: within a second"));
  ping_command->get_option("--timeout")->default_str("0.9");
  ping_command->callback([&, ping_command] {
    if (ping_command->count("--timeout") == 0) options.timeout_s = kPingTimeoutS;
    run = [&] { ping(options); };
  });
  const auto asks = [&](const char* name, const char* meaning, std::function<void(shearbus::Client&)> question) {
    auto* command = needs_server(app.add_subcommand(name, meaning));
    command->callback([&, question = std::move(question)] {
      run = [&options, question] {
        shearbus::Client client = connect(options);
        question(client);
      };
    });
    return command;
  };
  using shearbus::Client;
  namespace ctl = shearbus::ctl;
  asks("status", "What a server holds and has done", [&](Client& client) {
    ctl::show_status(client.server_status(), options.json);
  })->add_flag("--json", options.json, "As one line of JSON");
  asks("metrics", "The same and histograms, as Prometheus' text",
       [](Client& client) { fmt::print("{}", ctl::prometheus_text(client.server_status())); });
  asks("sessions", "The open sessions (operator)", [&](Client& client) {
    ctl::show_sessions(client, options.json);
  })->add_flag("--json", options.json, "As a line of JSON each");
  auto* top_command = asks("top", "A session's hottest, fastest or molten nodes (operator)",
                           [&](Client& client) { ctl::show_top(client, options.session, options.top, options.count); });
  top_command->add_option("SESSION", options.session,
                          "First digits of its id, or its scene's name; none: the only one");
  top_command->add_option("--by", options.top, "hottest, fastest or molten")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, shearbus::wire::Top>{{"hottest", shearbus::wire::Top::kHottest},
                                                     {"fastest", shearbus::wire::Top::kFastest},
                                                     {"molten", shearbus::wire::Top::kMolten}}));
  top_command->add_option("--count", options.count, "How many")
      ->check(CLI::Range(1U, static_cast<unsigned>(shearbus::wire::kMaxTopNodes)))
      ->capture_default_str();
  auto* close_command = asks("close", "Ends a session whose client is gone for good: its states are lost (operator)",
                             [&](Client& client) { ctl::close(client, options.session, options.idle_s); });
  close_command
      ->add_option("SESSION", options.session, "First digits of its id, or its scene's name where no other has it")
      ->required();
  close_command->add_option("--idle", options.idle_s, "Only where no request has come for so long, in seconds")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  asks("checkpoint", "Writes a checkpoint now (operator)", ctl::checkpoint);
  asks("drain", "No new sessions from here on (operator)", [&](Client& client) {
    ctl::drain(client, options.exit);
  })->add_flag("--exit", options.exit, "And the server ends when its last session is closed");
  auto* compare_command = app.add_subcommand(
      "compare", "Two checkpoint files: the first state that differs. Exit code 0: none, 1: one does, 2: trouble");
  compare_command->add_option("CHECKPOINTS", options.checkpoints, "Two of the files of a state directory")
      ->expected(2)
      ->required();
  compare_command->callback([&] { run = [&] { exit_code = compare(options); }; });
  auto* check_command = app.add_subcommand("check", "Is a scene valid? Prints it with every default filled in");
  check_command->add_option("SCENE", options.scene, "A TOML file")->required();
  check_command->callback([&] { run = [&] { check(options); }; });
  auto* keygen_command = app.add_subcommand("keygen", "Makes a pair of keys, NAME.public and NAME.secret");
  keygen_command->add_option("NAME", options.key_name, "Where, without the ending")->required();
  keygen_command->add_flag("--operator", options.key_of_operator,
                           "Whoever has it may operate the server: see every session, checkpoint, drain");
  keygen_command->callback([&] { run = [&] { keygen(options); }; });
  auto* materials_command =
      app.add_subcommand("materials", "The catalog of materials and where each number comes from");
  materials_command->add_option("MATERIAL", options.material,
                                "One of them, with its constants as a scene would give them");
  materials_command->callback([&] { run = [&] { materials(options); }; });
  app.add_subcommand("reference", "Every key of a scene, as Markdown")->callback([&] { run = reference; });
  app.add_subcommand("options", "What the physics can switch on and what excludes what, as Markdown")->callback([&] {
    run = options_page;
  });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    return app.exit(fault) == 0 ? 0 : kExitUsage;
  }
  const int trouble = compare_command->parsed() ? kExitUsage : kExitFault;
  try {
    run();
  } catch (const shearbus::Error& fault) {
    // The scene loader's text is a list of lines, each with its place: it stands for itself.
    const bool scene = fault.status().code == shearbus::Code::kInvalidScene;
    fmt::print(stderr, "{}{}\n", scene ? "" : "shearbus-ctl: ", scene ? fault.status().text : describe(fault.status()));
    return trouble;
  } catch (const std::exception& fault) {
    fmt::print(stderr, "{}\n", fault.what());
    return trouble;
  }
  return exit_code;
}
