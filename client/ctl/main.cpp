// shearbus-ctl: operates a running server, checks scenes, compares checkpoints, makes keys.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "client/ctl/operations.hpp"
#include "client/ctl/operator.hpp"
#include "client/ctl/rehearse.hpp"
#include "client/ctl/watch.hpp"
#include "proto/files/input_file.hpp"
#include "proto/files/key_file.hpp"
#include "proto/program/command_line.hpp"
#include "proto/program/program.hpp"
#include "proto/scene/reader.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/text.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/options_page.hpp"
#include "server/store/compare.hpp"
#include "server/version.hpp"

namespace {

namespace ctl = shearbus::ctl;
namespace fs = std::filesystem;

constexpr int kExitFault = 1;
constexpr int kExitTrouble = 2;  // of compare, as of diff
constexpr double kTimeoutS = 5.0;
constexpr double kPingTimeoutS = 0.9;
constexpr double kWaitTimeoutS = 60.0;
constexpr double kWatchTimeoutS = 1.0;
constexpr double kLookAgainS = 0.2;  // time between two questions to a server that recovers

struct Options {
  std::string server;
  std::filesystem::path server_key;
  std::filesystem::path key;
  double timeout_s = kTimeoutS;
  bool json = false;
  std::filesystem::path scene;
  std::string session;
  std::string domain;
  shearbus::wire::Top top = shearbus::wire::Top::kHottest;
  std::uint32_t count = 10;
  std::filesystem::path all;  // directory of endpoint files
  std::string listen;         // where metrics are served
  bool exit = false;
  std::uint64_t within_s = 0;
  double idle_s = 60.0;
  std::vector<std::filesystem::path> checkpoints;
  std::string key_name;
  bool key_of_operator = false;
  std::string material;
};

ctl::Operator connect(const Options& options, bool once = false) {
  shearbus::files::ServerAddress server{.endpoint = options.server};
  read_keys_into(server, options.server_key, options.key);  // refuses keys that do not go together
  return {server, options.timeout_s, once};
}

void ping(const Options& options) {
  const auto started = std::chrono::steady_clock::now();
  const ctl::Operator server = connect(options);
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - started;
  ctl::show_ping(server, options.server, took.count());
}

// Waits until a server answers that has recovered its sessions.
void wait_for_server(const Options& options) {
  const auto now = [] { return std::chrono::steady_clock::now(); };
  const auto end = now() + std::chrono::duration<double>(options.timeout_s);
  for (Options rest = options;;) {
    try {
      return ping(rest);
    } catch (const ctl::Error& fault) {
      rest.timeout_s = std::chrono::duration<double>(end - now()).count();
      if (fault.status().code != ctl::Code::kRecovering || rest.timeout_s <= kLookAgainS) throw;
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(kLookAgainS));
    rest.timeout_s -= kLookAgainS;
  }
}

// Returns 0 for equal checkpoints, otherwise 1, as diff does.
int compare(const Options& options) {
  for (const std::filesystem::path& file : options.checkpoints)
    if (std::filesystem::exists(file) && !std::filesystem::is_directory(file))
      const shearbus::files::RegularFile regular(file);  // a pipe is refused, which would keep the comparison waiting
  const std::string text = shearbus::store::first_difference(options.checkpoints[0], options.checkpoints[1]);
  fmt::print("{}\n", text.empty() ? "the same states" : text);
  return text.empty() ? 0 : kExitFault;
}

// Checks a scene: opens a session of it in a server inside this process, which checks schema and materials.
void check(const Options& options) {
  const std::string file = shearbus::program::shown(options.scene);
  const std::string text = shearbus::scene::load_text(options.scene);
  const bool left_out = shearbus::scene::read_file(options.scene) != text;
  const ctl::CheckedScene checked = ctl::check_scene(text, file);
  fmt::print("{}", checked.effective_scene);
  for (const std::string& warning : checked.warnings)
    shearbus::program::complain(fmt::format("{}: {}", file, shearbus::wire::labelled(warning)));
  shearbus::program::complain(fmt::format("{}: valid{}; {} bytes of state per node", file,
                                          left_out ? " without its table [hydro]" : "", checked.bytes_per_node));
  if (left_out) {
    // The reference hydrocode is built, but not installed, with this program.
    const fs::path hydro = fs::read_symlink("/proc/self/exe").replace_filename("shearbus-hydro");
    shearbus::program::complain(
        fmt::format("{0}: not checked: [hydro], which the reference hydrocode alone reads: {1} {0} --check{2}", file,
                    fs::exists(hydro) ? shearbus::program::shown(hydro) : "build/bin/shearbus-hydro",
                    fs::exists(hydro) ? "" : ", in the sources of shearbus"));
  }
}

// Writes a key pair; the public file is a line for a server's --authorized-keys.
void keygen(const Options& options) {
  const ctl::KeyPair pair = ctl::make_key_pair();
  const std::filesystem::path secret_file = options.key_name + ".secret";
  const std::filesystem::path public_file = options.key_name + ".public";
  if (std::filesystem::exists(public_file))  // checked before the secret key is written
    throw std::runtime_error(public_file.string() + ": exists already, and keys are never written over");
  shearbus::files::write_secret_key(secret_file, pair.secret_key);
  const std::string name = std::filesystem::path(options.key_name).filename().string();
  try {
    shearbus::files::write_public_key(
        public_file, {.key = pair.public_key, .words = (options.key_of_operator ? "operator " : "") + name});
  } catch (const std::exception&) {
    std::filesystem::remove(secret_file);  // useless without its public key
    throw;
  }
  fmt::print("{}: keep it where only its user can read it\n{}: {}\n", shearbus::program::shown(secret_file),
             shearbus::program::shown(public_file), pair.public_key);
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

// The commands of the program. Parsing the command line chooses the command that run() runs.
class Commands {
 public:
  explicit Commands(CLI::App& app) : app_(app) {
    with_server(add("ping", "Is a server there? For probes: within a second", ping), kPingTimeoutS);
    with_server(add("wait", "Waits until a server answers that has recovered its sessions", wait_for_server),
                kWaitTimeoutS);
    add_status();
    add_watch();
    add_metrics();
    add_inspections();
    add_operations();
    add_files();
    add_catalogs();
    add("rehearse", "Holds a host to problems with exact answers, by a mock server (rehearse --help)",
        [] { return 0; });
  }

  // Refuses one key file without the other, unless --all names servers, whose endpoint files hold their keys.
  void check_keys() const {
    const shearbus::files::ServerAddress address{.endpoint = options_.server};
    const std::string fault = shearbus::files::fault_of_keys(address, options_.server_key, options_.key);
    if (options_.all.empty() && !fault.empty()) throw CLI::ValidationError(fault);
  }
  int run() const { return run_(); }  // runs the chosen command and returns the exit code
  int exit_code_of_trouble() const { return exit_code_of_trouble_; }

 private:
  using Operator = ctl::Operator;

  // Adds a command that is run by `act`.
  CLI::App* add(const char* name, const char* meaning, std::function<int()> act) {
    CLI::App* command = app_.add_subcommand(name, meaning);
    command->callback([this, act = std::move(act)] { run_ = act; });
    return command;
  }
  CLI::App* add(const char* name, const char* meaning, void (*act)(const Options&)) {
    return add(name, meaning, [this, act] {
      act(options_);
      return 0;
    });
  }
  // Adds a command that connects to a server and asks it a question.
  CLI::App* ask(const char* name, const char* meaning, std::function<void(Operator&)> question) {
    return with_server(add(name, meaning, [this, question = std::move(question)] {
      Operator server = connect(options_, true);
      question(server);
      return 0;
    }));
  }

  // timeout_s: unless the command line has another.
  CLI::App* with_server(CLI::App* command, double timeout_s = kTimeoutS) {
    command->preparse_callback([this, timeout_s](std::size_t) { options_.timeout_s = timeout_s; });
    command
        ->add_option("--server", options_.server,
                     "Where the server listens, e.g. ipc:///run/user/1000/shearbus/bus, or file://PATH of its endpoint "
                     "file")
        ->type_name("ENDPOINT")
        ->required();
    command->add_option("--server-key", options_.server_key, "By tcp: file of the server's public key")
        ->type_name("FILE");
    command->add_option("--key", options_.key, "By tcp: file of one's own secret key")->type_name("FILE");
    command->add_option("--timeout", options_.timeout_s, "How long to wait for an answer, in seconds")
        ->check(CLI::Range(1e-3, 1e6))
        ->default_str(fmt::format("{}", timeout_s));
    return command;
  }

  void add_status() {
    CLI::App* command = with_server(add("status", "What a server holds and has done", [this] {
      if (!options_.all.empty()) return ctl::show_all(options_.all, options_.json, status_of()) ? 0 : kExitFault;
      Operator server = connect(options_);
      ctl::show_status(ctl::told_by(server), options_.json);
      return 0;
    }));
    command->add_flag("--json", options_.json, "As one line of JSON for each server");
    or_all(command);
  }

  // Lets a command take a directory of endpoint files instead of a server.
  CLI::Option* or_all(CLI::App* command) {
    CLI::Option* server = command->get_option("--server")->required(false);
    CLI::Option* all = command->add_option("--all", options_.all, "All servers with an endpoint file in this directory")
                           ->type_name("DIR")
                           ->check(CLI::ExistingDirectory);
    CLI::Option_group* which = command->add_option_group("which");
    which->add_options(server, all);
    which->require_option(1);
    return all;
  }

  ctl::StatusOf status_of() const {
    return [options = options_](const std::string& endpoint) {
      Options one = options;
      one.server = endpoint;
      Operator server = connect(one);
      return ctl::told_by(server);
    };
  }

  void add_watch() {
    CLI::App* command = with_server(
        add("watch", "Shows what a server does until Ctrl-C or, on a terminal's screen, q; else a line for each look",
            [this] {
              watch_.server = options_.server;
              const bool answered = ctl::watch(watch_, [this] { return connect(options_); });
              return watch_.looks > 0 && !answered ? 1 : 0;
            }),
        kWatchTimeoutS);
    command->add_option("--interval", watch_.interval_s, "Seconds between two looks")
        ->check(CLI::Range(0.1, 1e6))
        ->capture_default_str();
    command->add_flag("--json", watch_.json, "A line of JSON for each look");
    shearbus::program::whole_number(
        command->add_option(
            "--looks", watch_.looks,
            "End after so many looks, with exit code 1 if the last had no answer; rates come with the second"))
        ->check(CLI::PositiveNumber)
        ->type_name("N");
  }

  void add_metrics() {
    CLI::App* command = with_server(add("metrics", "The same and histograms, as Prometheus' text", [this] {
      if (options_.listen.empty()) {
        Operator server = connect(options_);
        fmt::print("{}", ctl::prometheus_text(ctl::told_by(server)));
        return 0;
      }
      ctl::serve_metrics(
          options_.listen,
          [options = options_] {
            return options.all.empty() ? ctl::ServerList{{options.server, options.server}}
                                       : ctl::servers_of(options.all);
          },
          status_of());
      return 0;
    }));
    CLI::Option* listen = command
                              ->add_option("--listen", options_.listen,
                                           "Serve them by HTTP at this address, for instance 127.0.0.1:9464, until "
                                           "SIGTERM; the servers are asked at each scrape")
                              ->type_name("ADDRESS:PORT");
    or_all(command)->needs(listen);
  }

  void add_inspections() {
    ask("sessions", "The open sessions (operator)", [this](Operator& server) {
      ctl::show_sessions(server, options_.json);
    })->add_flag("--json", options_.json, "As a line of JSON each");
    CLI::App* top = ask("top", "A session's hottest, fastest or molten nodes (operator)", [this](Operator& server) {
      ctl::show_top(server, options_.session, options_.top, options_.count);
    });
    top->add_option("SESSION", options_.session, "First digits of its id, or its scene's name; none: the only one");
    shearbus::program::add_choice<shearbus::wire::Top>(*top, "--by", options_.top,
                                                       {{"hottest", shearbus::wire::Top::kHottest},
                                                        {"fastest", shearbus::wire::Top::kFastest},
                                                        {"molten", shearbus::wire::Top::kMolten}},
                                                       "Which nodes")
        ->default_str("hottest");
    top->add_option("--count", options_.count, "How many")
        ->check(CLI::Range(1U, static_cast<unsigned>(shearbus::wire::kMaxTopNodes)))
        ->capture_default_str();
  }

  void add_operations() {
    CLI::App* close = ask("close", "Ends a session whose client is gone for good: its states are lost (operator)",
                          [this](Operator& server) {
                            if (options_.domain.empty())
                              ctl::close(server, options_.session, options_.idle_s);
                            else
                              ctl::close_domain(server, options_.domain, options_.idle_s);
                          });
    CLI::Option_group* which = close->add_option_group("which");
    which->add_option("SESSION", options_.session, "First digits of its id, or its scene's name where no other has it")
        ->check([](const std::string& text) { return text.empty() ? "expected an id or a name" : ""; });
    which->add_option("--domain", options_.domain, "All sessions of this domain");
    which->require_option(1);
    close->add_option("--idle", options_.idle_s, "Only where no request has come for so long, in seconds")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str();
    ask("checkpoint", "Writes a checkpoint now (operator)", ctl::checkpoint);
    CLI::App* drain = ask("drain", "No new sessions from here on (operator)",
                          [this](Operator& server) { ctl::drain(server, options_.exit, options_.within_s); });
    CLI::Option* exit = drain->add_flag("--exit", options_.exit, "And the server ends when its last session is closed");
    shearbus::program::whole_number(
        drain->add_option(
            "--within", options_.within_s,
            "The server ends after this time even if sessions are open, with a checkpoint and exit code 3"))
        ->type_name("SECONDS")
        ->check(CLI::Range(std::uint64_t{1}, shearbus::wire::kMaxDrainS))
        ->needs(exit);
  }

  void add_files() {
    add("compare", "Two checkpoint files: the first state that differs. Exit code 0: none, 1: one does, 2: trouble",
        [this] {
          exit_code_of_trouble_ = kExitTrouble;
          return compare(options_);
        })
        ->add_option("CHECKPOINTS", options_.checkpoints, "Two of the files of a state directory")
        ->expected(2)
        ->required();
    add("check", "Is a scene valid? Prints it with every default filled in", check)
        ->add_option("SCENE", options_.scene, "A TOML file")
        ->required();
    CLI::App* keys = add("keygen", "Makes a pair of keys, NAME.public and NAME.secret", keygen);
    keys->add_option("NAME", options_.key_name, "Where, without the ending")
        ->check([](const std::string& text) {
          return fs::path(text).has_filename() ? "" : fmt::format("expected a name of files, found \"{}\"", text);
        })
        ->required();
    keys->add_flag("--operator", options_.key_of_operator,
                   "Whoever has it may operate the server: see every session, checkpoint, drain");
  }

  void add_catalogs() {
    add("materials", "The catalog of materials and where each number comes from", materials)
        ->add_option("MATERIAL", options_.material, "One of them, with its constants as a scene would give them");
    add("reference", "Every key of a scene, as Markdown",
        [](const Options&) { fmt::print("{}", shearbus::scene::reference_of(*shearbus::v1::Scene::descriptor())); });
    add("options", "What the physics can switch on and what excludes what, as Markdown",
        [](const Options&) { fmt::print("{}", shearbus::physics::options_page()); });
  }

  CLI::App& app_;
  Options options_;
  ctl::WatchOptions watch_;
  std::function<int()> run_;
  int exit_code_of_trouble_ = kExitFault;
};

}  // namespace

constexpr const char* kFooter = R"(Examples:
  shearbus-ctl status --server ipc:///run/user/1000/shearbus/bus
  shearbus-ctl watch --server file://endpoint
  shearbus-ctl check scene.toml

Exit codes: 0 done, 1 trouble (of compare: states differ), 2 a wrong command line (of compare:
trouble).)";

int main(int argc, char** argv) {
  shearbus::program::begin_program();
  CLI::App app{"Questions to a running shearbus server, and about scenes."};
  app.require_subcommand(1);
  Commands commands(app);
  shearbus::program::complete(app, "shearbus-ctl", shearbus::server::version_text, kFooter);
  const std::span words(argv, static_cast<std::size_t>(argc));
  const bool rehearses = argc > 1 && std::string_view(argv[1]) == "rehearse";  // it reads its own arguments
  if (!rehearses)
    if (const auto code = shearbus::program::parse(app, argc, argv, [&] { commands.check_keys(); })) return *code;
  try {
    if (rehearses) ctl::rehearse(words.subspan(2));
    return shearbus::program::end_program("shearbus-ctl", commands.run());
  } catch (const ctl::Error& fault) {
    // For a scene at fault the text is a list of lines "file:line:column: ...", which is printed without a prefix.
    const bool scene = fault.status().code == ctl::Code::kInvalidScene;
    if (scene)
      shearbus::program::complain(fault.status().text);
    else
      shearbus::program::complain("shearbus-ctl", fault);
  } catch (const std::exception& fault) {
    shearbus::program::complain("shearbus-ctl", fault);
  }
  return commands.exit_code_of_trouble();
}
