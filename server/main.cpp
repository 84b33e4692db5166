// shearbus-server: reads the options, constructs the parts of the server in the order of their dependencies, runs until
// a stop signal, or until its last session is closed after a drain, and destroys the parts in reverse order.
#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pthread.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/files/endpoint_file.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/command_line.hpp"
#include "proto/program/program.hpp"
#include "proto/wire/handle.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/access.hpp"
#include "server/host.hpp"
#include "server/options.hpp"
#include "server/own_laws.hpp"
#include "server/server.hpp"
#include "server/transport/endpoint.hpp"
#include "server/version.hpp"

namespace {

using shearbus::server::Server;
using shearbus::server::ServerOptions;
using shearbus::server::ServiceManager;
using shearbus::wire::counted;

constexpr int kExitFault = 1;
constexpr int kExitSessionsOpen = 3;  // an operator's drain ran out of time

void add_options(CLI::App& app, ServerOptions& options) {
  app.add_option("--bind", options.endpoints,
                 "Where to listen, repeatable: ipc://PATH (this machine; in a directory of the server's own) or "
                 "tcp://ADDRESS:PORT (with keys)")
      ->type_name("ENDPOINT")
      ->required();
  app.add_option("--endpoint-file", options.endpoint_file,
                 "Gets the address and the public key of the server once it listens, for clients: file://FILE. Removed "
                 "at the end")
      ->type_name("FILE");
  app.add_option("--threads", options.threads, "Threads that solve layers; 0: one per core")
      ->check(CLI::Range(0U, shearbus::wire::kMaxThreads))
      ->capture_default_str();
  app.add_option("--nodes-per-task", options.nodes_per_task, "Steps of fewer nodes are solved on one thread")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--max-work-budget", options.max_work_budget,
                 "Largest work_budget of a scene: the most work of a node in one step, in evaluations of a cell, of "
                 "which a core makes some 1e8 a second")
      ->check(CLI::Range(3e8, 1e15))
      ->capture_default_str();
  app.add_option("--friction-law", options.own_laws,
                 "A friction law of a shared library, repeatable: scenes name it as friction_law = \"own:NAME\" "
                 "(shearbus/friction_law.h)")
      ->type_name("NAME=FILE");
  app.add_option_function<std::uint64_t>(
         "--state-memory-mb", [&](const std::uint64_t& mb) { options.max_state_bytes = mb << 20; },
         "Memory for the states of all sessions, in MB; by default three quarters of the machine's")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 30));
  app.add_option("--sessions-per-user", options.sessions_per_user,
                 "Sessions that one user, or key, may have open, except operators; by default three quarters of all")
      ->check(CLI::Range(std::size_t{1}, shearbus::wire::kMaxSessions));
  app.add_option_function<std::uint64_t>(
         "--memory-per-user-mb", [&](const std::uint64_t& mb) { options.state_bytes_per_user = mb << 20; },
         "Memory for the states of one user's sessions, in MB, except operators'; by default three quarters of the "
         "memory for all")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 30));
  auto* const state = app.add_option("--state-dir", options.state_dir,
                                     "Directory in which sessions outlive the server; without one they end with it")
                          ->type_name("DIR");
  shearbus::program::add_choice(
      app, "--durability", options.durability, {"none", "process", "power"},
      "What an answer outlives, with --state-dir: nothing, the death of the server, or the loss "
      "of power")
      ->default_str(options.durability);
  app.add_option("--checkpoint-every", options.checkpoint_every_s,
                 "Seconds between two checkpoints, where anything has changed")
      ->check(CLI::Range(1.0, 1e6))
      ->capture_default_str();
  app.add_option("--checkpoint-after", options.checkpoint_after_mb, "MB of journal between two checkpoints")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 20))
      ->capture_default_str();
  app.add_option("--checkpoint-work", options.checkpoint_work,
                 "Work of the solver between two checkpoints, in evaluations of a cell, of which a core makes some 1e8 "
                 "a second: bounds the time that a restart takes")
      ->check(CLI::Range(1e6, 1e18))
      ->capture_default_str();
  app.add_option(
         "--capsules", options.max_capsules,
         "Failure capsules kept in --state-dir, of nodes that had no answer; shearbus-replay --capsule runs one again")
      ->check(CLI::Range(std::size_t{0}, std::size_t{10'000}))
      ->capture_default_str();
  app.add_option("--drop-session", options.drop_sessions,
                 "Recover without this session, given by the first 8 or more digits of its id, repeatable. Its states "
                 "and requests are set aside in files dropped-*; the other sessions are untouched")
      ->type_name("ID");
  shearbus::program::whole_number(
      app.add_option(
          "--drop-record", options.drop_records,
          "Recover without this record of the journal and the later ones of its session, repeatable: the session "
          "stands before it"))
      ->type_name("NUMBER");
  app.add_flag("--accept-empty", options.accept_empty,
               "Where the state directory cannot be used, set its files aside and start without states");
  for (const char* name : {"--durability", "--checkpoint-every", "--checkpoint-after", "--checkpoint-work",
                           "--capsules", "--drop-session", "--drop-record", "--accept-empty"})
    app.get_option(name)->needs(state);
  auto* const record =
      app.add_option("--record", options.record_dir,
                     "Directory that gets an event log of each session, for shearbus-replay: requests and replies as "
                     "they were, for the owner's eyes only")
          ->type_name("DIR");
  app.add_option("--record-session", options.record_sessions,
                 "With --record: only sessions of this scene's name or domain, repeatable")
      ->type_name("NAME")
      ->needs(record);
  shearbus::program::whole_number(
      app.add_option("--allow-uid", options.allow_uids,
                     "Users who may connect by ipc beside the one the server runs as, by number, repeatable"))
      ->type_name("UID");
  app.add_option("--curve-secret", options.curve_secret,
                 "File of the server's secret key, from shearbus-ctl keygen: tcp clients must have keys, too")
      ->type_name("FILE");
  app.add_option("--authorized-keys", options.authorized_keys,
                 "File of the public keys of tcp clients, one a line; read again when it has changed")
      ->type_name("FILE");
  app.add_flag("--insecure-plaintext", options.insecure_plaintext,
               "Allow tcp without keys: whoever reaches the address is served, unknown and unencrypted");
  shearbus::program::add_choice(
      app, "--log-level", options.log_level, {"trace", "debug", "info", "warn", "error", "off"},
      "How much to say; error leaves the lines that need the operator: ALARM, FAILED, LOST and "
      "DAMAGED")
      ->default_str(options.log_level);
  app.add_option("--log-file", options.log_file, "Where to say it; by default standard error")->type_name("FILE");
}

constexpr const char* kFooter = R"(Examples:
  shearbus-server --bind ipc:///run/user/1000/shearbus/bus --state-dir states
  shearbus-server --bind tcp://10.0.0.1:7447 --curve-secret server.secret --authorized-keys keys

Exit codes: 0 stopped, 1 a fault, 2 a wrong command line, 3 the time of a drain was over and
sessions were open.)";

// Throws CLI::ParseError for options that no server can have, whatever is on the disk.
void check_command_line(const ServerOptions& options) try {
  shearbus::server::Access::check(options);
  std::set<std::string> seen;
  for (const std::string& text : options.endpoints) {
    const auto endpoint = shearbus::transport::Endpoint::parse(text);
    if (endpoint.scheme == shearbus::transport::Scheme::kInproc)
      throw std::invalid_argument(
          fmt::format("--bind {}: no other process reaches it; expected ipc:// or tcp://", text));
    const std::string place =
        endpoint.path.empty() ? text : std::filesystem::absolute(endpoint.path).lexically_normal().string();
    if (endpoint.port != "*" && !seen.insert(place).second)
      throw std::invalid_argument(fmt::format("--bind {} is given twice; leave out one of the two", text));
    if (options.curve_secret.empty() && !options.insecure_plaintext) endpoint.refuse_unprotected();
  }
  for (const std::string& law : options.own_laws) static_cast<void>(shearbus::server::own_law_of(law));
} catch (const std::exception& fault) {
  throw CLI::ValidationError(fault.what());
}

// Every line of a log begins with its time.
bool is_log(const std::filesystem::path& file) {
  const std::string text = shearbus::files::head_of(file, 11);
  return text.size() == 11 && text[4] == '-' && text[7] == '-' && text[10] == 'T' &&
         text.find_first_not_of("0123456789-T") == std::string::npos;
}
constexpr shearbus::files::FileKind kLogFile = {"a log of shearbus-server", is_log};

// Throws for an output that is an input, or that would write over or into a file of another kind.
void check_outputs(const ServerOptions& options) {
  const std::array<shearbus::files::InputFile, 2> inputs = {
      {{"--curve-secret", options.curve_secret}, {"--authorized-keys", options.authorized_keys}}};
  shearbus::files::refuse_inputs_as_output("--endpoint-file", options.endpoint_file, inputs);
  shearbus::files::refuse_inputs_as_output("--log-file", options.log_file, inputs);
  if (!options.endpoint_file.empty()) {
    shearbus::files::check_output(options.endpoint_file, shearbus::files::kEndpointFile);
    shearbus::files::refuse_file_of_running_server(options.endpoint_file);
  }
  std::error_code ignored;
  const bool device = std::filesystem::is_character_file(options.log_file, ignored) ||
                      std::filesystem::is_fifo(options.log_file, ignored);
  if (!options.log_file.empty() && !device) shearbus::files::check_output(options.log_file, kLogFile);
}

// The words with which the server begins the lines that an operator must see, however little is logged.
constexpr std::array<std::pair<std::string_view, spdlog::level::level_enum>, 7> kWords = {{
    {"ALARM: ", spdlog::level::err},     // something needs the operator
    {"FAILED: ", spdlog::level::err},    // the server ends, or admits nobody
    {"LOST: ", spdlog::level::err},      // answered requests are missing on the disk
    {"DAMAGED: ", spdlog::level::err},   // a file cannot be used; others stand in
    {"FOREIGN: ", spdlog::level::warn},  // a file of another server
    {"REFUSED: ", spdlog::level::warn},  // a peer asked for what it may not
    {"WARNING: ", spdlog::level::warn},
}};

spdlog::level::level_enum level_of(std::string_view line) {
  const auto* const word = std::ranges::find_if(kWords, [&](const auto& row) { return line.starts_with(row.first); });
  return word != kWords.end() ? word->second : spdlog::level::info;
}

// The text of a line of the log, whatever names of strangers it quotes.
class PrintableText : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& line) override {
    constexpr std::size_t kLongest = std::size_t{16} << 10;
    const std::string text = shearbus::wire::printable({message.payload.data(), message.payload.size()}, kLongest);
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<PrintableText>(); }
};

void start_log(const ServerOptions& options) {
  spdlog::sink_ptr sink;
  if (options.log_file.empty()) {
    sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  } else {
    const std::string file = shearbus::files::target_of_output(options.log_file).string();
    // The logging library would make the file with mode 0666.
    const shearbus::wire::Descriptor made(
        ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0640));
    if (made < 0)
      throw std::runtime_error("--log-file " + file + " cannot be opened for writing: " + std::strerror(errno) +
                               "; name a file that this user may write");
    sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(file);
  }
  auto logger = std::make_shared<spdlog::logger>("shearbus-server", std::move(sink));
  logger->set_level(spdlog::level::from_str(options.log_level));
  logger->flush_on(spdlog::level::info);
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableText>('*').set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %^%l%$ %*");
  logger->set_formatter(std::move(formatter));
  spdlog::set_default_logger(std::move(logger));
}

// Returns a descriptor from which the stop signals are read. A terminal that hangs up stops the server as well, unless
// the caller has asked to ignore that (nohup). If the server's output goes to a pipe, the end of the reader does not
// stop the server. Must be called before any thread exists: all threads then inherit the blocked signals, and no signal
// interrupts one of them.
shearbus::wire::Descriptor block_stop_signals() {
  sigset_t stop;
  sigemptyset(&stop);
  sigaddset(&stop, SIGTERM);
  sigaddset(&stop, SIGINT);
  struct sigaction hangup {};
  if (sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) sigaddset(&stop, SIGHUP);
  static_cast<void>(std::signal(SIGPIPE, SIG_IGN));
  pthread_sigmask(SIG_BLOCK, &stop, nullptr);
  return shearbus::wire::Descriptor(::signalfd(-1, &stop, SFD_CLOEXEC | SFD_NONBLOCK));
}

// Returns the exit code.
int run(const ServerOptions& options) {
  check_outputs(options);
  const shearbus::wire::Descriptor stop_fd = block_stop_signals();
  start_log(options);
  ServiceManager manager;
  spdlog::info(
      "shearbus-server {} (commit {}): bind [{}], threads {}, nodes per task {}, state memory {}, state directory {}, "
      "recordings {}, log level {}",
      SHEARBUS_RELEASE, shearbus::server::kCommit, fmt::join(options.endpoints, ", "),
      options.threads == 0 ? "auto" : std::to_string(options.threads), options.nodes_per_task,
      options.max_state_bytes != 0 ? fmt::format("{} MB", options.max_state_bytes >> 20) : "auto",
      options.state_dir.empty()
          ? "none: sessions end with the server"
          : fmt::format("{}, durability {}{}, a checkpoint every {} s, {} MB or {:g} evaluations", options.state_dir,
                        options.durability, options.accept_empty ? " (accept empty)" : "", options.checkpoint_every_s,
                        options.checkpoint_after_mb, options.checkpoint_work),
      options.record_dir.empty() ? "none" : options.record_dir, options.log_level);
  shearbus::server::load_own_laws(options.own_laws);
  for (const std::string& law : options.own_laws) spdlog::info("friction law own:{}", law);
  bool sessions_open = false;
  {
    Server server(options, {.info = [](const std::string& line) { spdlog::log(level_of(line), "{}", line); },
                            .debug = [](const std::string& line) { spdlog::debug("{}", line); }});
    if (!options.curve_secret.empty())
      spdlog::info("clients by tcp need this server key: {}", server.access().public_key());
    if (options.insecure_plaintext)
      spdlog::warn("INSECURE: whoever reaches a tcp address of this server is served, unknown and unencrypted");
    std::vector<std::string> bound;
    for (const std::string& endpoint : options.endpoints) bound.push_back(server.bind(endpoint));
    std::optional<shearbus::files::PublishedEndpoint> published;
    if (!options.endpoint_file.empty()) {
      const std::string name = shearbus::server::machine_name(), host = name.empty() ? "localhost" : name;
      published.emplace(
          options.endpoint_file,
          shearbus::files::EndpointFile{.version = SHEARBUS_RELEASE,
                                        .host = host,
                                        .server_key = options.curve_secret.empty() ? "" : server.access().public_key(),
                                        .endpoint = shearbus::files::address_for_clients(bound.front(), host),
                                        .epoch = fmt::format("{:016x}", server.epoch())});
    }
    if (!server.recover(stop_fd, &manager)) {
      spdlog::info("stopped during the recovery; the next server begins it again");
      return 0;
    }
    for (const std::string& endpoint : bound) spdlog::info("listening on {}", endpoint);
    manager.ready(fmt::format("listening on {}", fmt::join(options.endpoints, ", ")));
    server.run(stop_fd, &manager);
    const auto status = server.status();
    spdlog::info("stopping: {} ({} refused, {} repeated), {}, {} open, {} undeliverable",
                 counted(status.requests, "request"), status.refused, status.replayed,
                 counted(status.node_steps, "node-step"), counted(status.sessions, "session"),
                 counted(server.transport().peer_gone + server.transport().peer_full, "answer"));
    sessions_open = server.ended_with_sessions();
    if (sessions_open)
      spdlog::warn("the time that an operator gave the sessions is over; {} open{}",
                   counted(status.sessions, "session"),
                   options.state_dir.empty() ? ": lost" : ", to continue with the next server");
  }
  spdlog::info("stopped");
  return sessions_open ? kExitSessionsOpen : 0;
}

}  // namespace

int main(int argc, char** argv) {
  shearbus::program::begin_program();
  CLI::App app{
      "The subgrid friction server of shearbus: it owns the shear layers of interface nodes and steps them for "
      "clients."};
  ServerOptions options;
  add_options(app, options);
  shearbus::program::complete(app, "shearbus-server", shearbus::server::version_text, kFooter);
  if (const auto code = shearbus::program::parse(app, argc, argv, [&] { check_command_line(options); })) return *code;
  try {
    return run(options);
  } catch (const std::exception& fault) {
    shearbus::program::complain("shearbus-server", fault);
    return kExitFault;
  }
}
