// shearbus-ctl: questions to a running server, and about scenes.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>

#include "client/include/shearbus/client.hpp"
#include "proto/wire/key_file.hpp"
#include "proto/wire/scene_file.hpp"
#include "server/embedded.hpp"

namespace {

constexpr int kExitFault = 1;
constexpr int kExitUsage = 2;

struct Options {
  std::string server;
  std::filesystem::path server_key;
  std::filesystem::path key;
  double timeout_s = 5.0;
  bool json = false;
  std::filesystem::path scene;
  std::string key_name;
  bool key_of_operator = false;
};

shearbus::Client connect(const Options& options) {
  const auto deadline = std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options.timeout_s));
  shearbus::wire::ServerAddress server(options.server);
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
  const auto& welcome = client.welcome();
  fmt::print("{}: server {}, protocol {}.{}, answered in {:.1f} ms\n", options.server, welcome.server_version,
             welcome.protocol_major, welcome.protocol_minor, took.count());
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (static_cast<unsigned char>(c) >= 0x20) out += c;
  }
  return out;
}

void status(const Options& options) {
  const auto s = connect(options).server_status();
  if (options.json) {
    fmt::print(
        "{{\"server_version\": \"{}\", \"uptime_s\": {:.3f}, \"threads\": {}, \"sessions\": {}, \"nodes\": {}, "
        "\"state_bytes\": {}, \"requests\": {}, \"refused\": {}, \"replayed\": {}, \"node_steps\": {}, \"solver_s\": "
        "{:.6f}}}\n",
        escaped(s.server_version), 1e-9 * static_cast<double>(s.uptime_ns), s.threads, s.sessions, s.nodes,
        s.state_bytes, s.requests, s.refused, s.replayed, s.node_steps, 1e-9 * static_cast<double>(s.solver_ns));
    return;
  }
  const auto line = [](const char* what, const std::string& value) { fmt::print("{:<12} {}\n", what, value); };
  line("server", fmt::format("{} ({} threads), up {:.0f} s", s.server_version, s.threads,
                             1e-9 * static_cast<double>(s.uptime_ns)));
  line("sessions", fmt::format("{} with {} nodes, {:.1f} MB of states", s.sessions, s.nodes,
                               static_cast<double>(s.state_bytes) / (1 << 20)));
  line("requests", fmt::format("{} ({} refused, {} repeated)", s.requests, s.refused, s.replayed));
  const double per_step_ns =
      s.node_steps == 0 ? 0.0 : static_cast<double>(s.solver_ns) / static_cast<double>(s.node_steps);
  line("node-steps", fmt::format("{} in {:.3f} s of solver time ({:.0f} ns each)", s.node_steps,
                                 1e-9 * static_cast<double>(s.solver_ns), per_step_ns));
}

// Reads a scene and has a server of our own understand it: the file's schema and the materials both speak.
void check(const Options& options) {
  const shearbus::wire::SceneFile file = shearbus::wire::load_scene_file(options.scene);
  const shearbus::server::Embedded server;
  shearbus::Client client({.endpoint = server.endpoint(), .context = server.context(), .name = "shearbus-ctl"});
  try {
    const std::array<std::uint64_t, 1> node = {0};
    shearbus::Session session = client.open(file.scene, node);
    fmt::print("{}", shearbus::wire::scene_to_toml(session.effective_scene()));
    for (const std::string& warning : session.warnings()) fmt::print(stderr, "{}: warning: {}\n", file.file, warning);
    fmt::print(stderr, "{}: valid; {} bytes of state per node\n", file.file, session.bytes_per_node());
    session.close();
  } catch (const shearbus::Error& fault) {
    if (fault.status().code != shearbus::Code::kInvalidScene) throw;
    throw std::runtime_error(fmt::format("{}: {}", file.where(fault.status().field), fault.status().text));
  }
}

// The public file is a line for a server's --authorized-keys.
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

void reference() {
  fmt::print("{}", shearbus::wire::scene_reference());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Questions to a running shearbus server, and about scenes."};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("shearbus-ctl ") + SHEARBUS_VERSION);
  Options options;
  std::function<void()> run;

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
  needs_server(app.add_subcommand("ping", "Is a server there?"))->callback([&] { run = [&] { ping(options); }; });
  auto* status_command = needs_server(app.add_subcommand("status", "What a server holds and has done"));
  status_command->add_flag("--json", options.json, "As one line of JSON");
  status_command->callback([&] { run = [&] { status(options); }; });
  auto* check_command = app.add_subcommand("check", "Is a scene valid? Prints it with every default filled in");
  check_command->add_option("SCENE", options.scene, "A TOML file")->required();
  check_command->callback([&] { run = [&] { check(options); }; });
  auto* keygen_command = app.add_subcommand("keygen", "Makes a pair of keys, NAME.public and NAME.secret");
  keygen_command->add_option("NAME", options.key_name, "Where, without the ending")->required();
  keygen_command->add_flag("--operator", options.key_of_operator,
                           "Whoever has it may operate the server: see every session, checkpoint, drain");
  keygen_command->callback([&] { run = [&] { keygen(options); }; });
  app.add_subcommand("reference", "Every key of a scene, as Markdown")->callback([&] { run = reference; });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    return app.exit(fault) == 0 ? 0 : kExitUsage;
  }
  try {
    run();
  } catch (const shearbus::Error& fault) {
    // The scene loader's text is a list of lines, each with its place: it stands for itself.
    const bool scene = fault.status().code == shearbus::Code::kInvalidScene;
    fmt::print(stderr, "{}{}\n", scene ? "" : "shearbus-ctl: ", scene ? fault.status().text : describe(fault.status()));
    return kExitFault;
  } catch (const std::exception& fault) {
    fmt::print(stderr, "{}\n", fault.what());
    return kExitFault;
  }
  return 0;
}
