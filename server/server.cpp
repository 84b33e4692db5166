#include "server/server.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstring>
#include <optional>
#include <random>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/wire/limits.hpp"

namespace shearbus::server {
namespace {

constexpr int kLookAfterMs = 1'000;
constexpr double kSliceWork = 1e6;  // work of each thread between two looks at the socket, about 10 ms  [evaluations]
constexpr std::uint64_t kFinishNs = 5'000'000'000;  // longest time for steps being computed when the server is stopped
constexpr std::uint64_t kLookWhileReplayingNs = 10'000'000;
constexpr int kLookAsideMs = 5;  // time between two looks at work aside when the server is stopped
constexpr std::size_t kRefusedAtStop = 4 * wire::kMaxSessions;  // largest number of requests refused at the end

std::uint64_t random_epoch() {
  std::random_device source;
  const std::uint64_t epoch = (std::uint64_t{source()} << 32) | source();
  return epoch != 0 ? epoch : 1;
}

store::StoreId random_store_id() {
  std::random_device source;
  store::StoreId id{};
  for (std::uint8_t& byte : id) byte = static_cast<std::uint8_t>(source());
  return id;
}

std::uint64_t three_quarters_of_memory() {
  const auto pages = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES));
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) / 4 * 3;
}

store::Durability durability_from(const std::string& word) {
  for (const auto known : {store::Durability::kNone, store::Durability::kProcess, store::Durability::kPower})
    if (word == store::name(known)) return known;
  throw std::invalid_argument("durability \"" + word + "\" is not known; use none, process or power");
}

// A user leaves a quarter of the sessions and of the memory to others.
constexpr std::uint64_t quota(std::uint64_t wanted, std::uint64_t whole) {
  return wanted != 0 ? std::min(wanted, whole) : whole - whole / 4;
}

service::ServiceOptions service_options(const ServerOptions& options, std::uint64_t epoch, const Log& log) {
  const std::uint64_t memory = options.max_state_bytes != 0 ? options.max_state_bytes : three_quarters_of_memory();
  return {.epoch = epoch,
          .server_version = SHEARBUS_RELEASE,
          .max_state_bytes = memory,
          .max_sessions_per_user = quota(options.sessions_per_user, wire::kMaxSessions),
          .max_state_bytes_per_user = quota(options.state_bytes_per_user, memory),
          .nodes_per_task = options.nodes_per_task,
          .slice_work = kSliceWork,
          .max_work_budget = options.max_work_budget,
          .now_ns = monotonic_ns,
          .cpu_ns = thread_cpu_ns,
          .log = log.info};
}

store::StoreOptions store_options(const ServerOptions& options, std::uint64_t epoch, const Log& log) {
  return {.durability = durability_from(options.durability),
          .epoch = epoch,
          .checkpoint_bytes = options.checkpoint_after_mb << 20,
          .checkpoint_work = options.checkpoint_work,
          .max_capsules = options.max_capsules,
          .fresh_id = random_store_id(),
          .leave_out = {.sessions = options.drop_sessions, .records = options.drop_records},
          .accept_empty = options.accept_empty,
          .log = log.info};
}

// A recording that fails needs the operator, unlike one that began too late.
// What a signal that ends the server in a recovery tells: the record, in which a friction law of the server's own may crash.
std::array<char, 256> last_words{};

extern "C" void tell_last_words(int signal) {
  static_cast<void>(::write(STDERR_FILENO, last_words.data(), ::strnlen(last_words.data(), last_words.size())));
  static_cast<void>(::raise(signal));  // which has its default again
}

constexpr std::array kFatalSignals{SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT};

class LastWords {
 public:
  LastWords() {
    struct sigaction act {};
    act.sa_handler = &tell_last_words;
    act.sa_flags = static_cast<int>(SA_RESETHAND | SA_NODEFER);
    for (std::size_t i = 0; i < kFatalSignals.size(); ++i) ::sigaction(kFatalSignals[i], &act, &before_[i]);
  }
  LastWords(const LastWords&) = delete;
  LastWords& operator=(const LastWords&) = delete;
  ~LastWords() {
    for (std::size_t i = 0; i < kFatalSignals.size(); ++i) ::sigaction(kFatalSignals[i], &before_[i], nullptr);
  }

 private:
  std::array<struct sigaction, kFatalSignals.size()> before_{};
};

std::function<void(const std::string&, bool)> log_of_recordings(const Log& log) {
  if (!log.info) return {};
  return [info = log.info](const std::string& line, bool failed) { info((failed ? "ALARM: " : "WARNING: ") + line); };
}

}  // namespace

Server::Server(const ServerOptions& options, const Log& log)
    : epoch_(random_epoch()),
      pool_(options.threads),
      storage_(options.state_dir.empty() ? nullptr : std::make_unique<store::PosixStorage>(options.state_dir)),
      store_(storage_ ? std::make_unique<store::Store>(*storage_, store_options(options, epoch_, log)) : nullptr),
      recorder_(options.record_dir.empty() ? nullptr
                                           : std::make_unique<files::SessionRecorder>(
                                                 files::RecorderOptions{.place = options.record_dir,
                                                                        .recorder = files::Recorder::kServer,
                                                                        .sessions = options.record_sessions,
                                                                        .log = log_of_recordings(log)})),
      service_(with_hooks(service_options(options, epoch_, log)), pool_, store_.get()),
      access_(options),
      router_({.max_frame_bytes = wire::kMaxPayloadBytes,
               .authorise = [this](const transport::Peer& peer) { return access_.judge(peer); },
               .ipc_users = access_.other_users(),
               .curve_secret_key = access_.secret_key(),
               .insecure_plaintext = options.insecure_plaintext,
               .log = log.debug,
               .log_access = log.info}),
      checkpoint_every_ns_(static_cast<std::uint64_t>(1e9 * options.checkpoint_every_s)),
      last_checkpoint_ns_(monotonic_ns()),
      log_(log.info) {}

// The service may still read messages that the router has.
Server::~Server() {
  service_.give_up();
}

bool Server::recover(int stop_fd, ServiceManager* manager) {
  if (!store_) return true;
  stop_fd_ = stop_fd;
  manager_ = manager;
  looked_at_socket_ns_ = looked_after_ns_ = monotonic_ns();
  std::optional<LastWords> last;
  if (manager != nullptr) last.emplace();  // not in the process of a host
  try {
    service_.recover();
  } catch (const store::Interrupted&) {
    return false;
  }
  return true;
}

// Called between the requests that are replayed, and between the slices of their steps.
void Server::while_replaying() {
  if (manager_ != nullptr) {
    const std::string at = store_->replaying();  // its last word is the session
    const auto end =
        fmt::format_to_n(last_words.data(), last_words.size() - 1,
                         "ALARM: the server ends by a signal in the replay of {}. If a friction law of its "
                         "own is at fault, start it without the session: --drop-session {}\n",
                         at, std::string_view(at).substr(at.rfind(' ') + 1));
    *end.out = '\0';
  }
  const std::uint64_t now = monotonic_ns();
  if (now - looked_at_socket_ns_ < kLookWhileReplayingNs) return;
  looked_at_socket_ns_ = now;
  pollfd stop{.fd = stop_fd_, .events = POLLIN, .revents = 0};
  if (stop_fd_ >= 0 && ::poll(&stop, 1, 0) > 0) throw store::Interrupted();
  std::optional<service::ReplyFrames> reply;  // the last one: its header is copied when the handler has returned
  router_.answer_waiting(
      [&](transport::Frames frames, std::string_view) {
        reply = service_.refuse_while_recovering(frames);
        if (!reply) return transport::Answer();
        return transport::Answer(transport::OutFrame{std::as_bytes(std::span(reply->header)), nullptr});
      },
      kRefusedAtStop);
  if (now - looked_after_ns_ < std::uint64_t{1'000'000} * kLookAfterMs) return;
  looked_after_ns_ = now;
  const int percent = static_cast<int>(100.0 * store_->share_replayed());
  const std::string at = store_->replaying();
  if (log_)
    log_("recovering: " + std::to_string(percent) + " % of the journal is replayed" + (at.empty() ? "" : ", at ") + at);
  if (manager_ != nullptr) manager_->recovering(percent);
}

// Writes a checkpoint if one is due. Called between requests, after the last answer has been sent, and while no
// requests arrive.
void Server::checkpoint_if_due() {
  if (!store_) return;
  service_.end_checkpoint(false);
  if (service_.checkpointing() || !store_->changed_since_checkpoint()) return;
  const std::uint64_t now = monotonic_ns();
  if (!store_->checkpoint_due() && now - last_checkpoint_ns_ < checkpoint_every_ns_) return;
  service_.begin_checkpoint();
}

service::ServiceOptions Server::with_hooks(service::ServiceOptions options) {
  options.while_replaying = [this] { while_replaying(); };
  options.wake = [this] { wake_.set(); };
  options.complete_status = [this](wire::ServerStatus& status) { complete_status(status); };
  if (recorder_)
    options.exchanged = [this](service::Frames request, const service::ReplyFrames& reply) {
      recorder_->add({.request_header = request[0],
                      .request_payload = request.size() > 1 ? request[1] : std::span<const std::byte>(),
                      .reply_header = std::as_bytes(std::span(reply.header)),
                      .reply_payload = reply.payload});
    };
  options.around_checkpoint = [this](bool begins) {
    if (!begins) last_checkpoint_ns_ = monotonic_ns();
    if (manager_ == nullptr) return;
    if (begins)
      manager_->checkpoint_begins();
    else
      manager_->checkpoint_ends();
  };
  return options;
}

// Ten times a second: what takes time in proportion to the number of sessions, and need not be done at once.
void Server::look_at_sessions() {
  constexpr std::uint64_t kEveryNs = 100'000'000;
  const std::uint64_t now = monotonic_ns();
  if (now - looked_at_sessions_ns_ < kEveryNs) return;
  looked_at_sessions_ns_ = now;
  service_.close_idle_sessions();
  service_.prove_last_replies();
}

// Once a second: notifies the watchdog, and warns the operator of peers that were kept from using up file descriptors
// or memory. Connected clients are still served.
void Server::look_after() {
  const std::uint64_t now = monotonic_ns();
  if (now - looked_after_ns_ < std::uint64_t{1'000'000} * kLookAfterMs) return;
  looked_after_ns_ = now;
  manager_->alive();
  for (const std::string& line : access_.look_for_revoked())
    if (log_) log_(line);
  if (access_.any_revoked())
    if (const std::size_t ended = router_.end_connections([&](auto user) { return access_.revoked(user); });
        ended != 0 && log_)
      log_(fmt::format("{} connections of revoked keys were closed", ended));
  for (const std::string& line : router_.look_after_paths())
    if (log_) log_(line);
  const bool run_out = files_run_out();
  if (run_out != files_run_out_ && log_)
    log_(run_out
             ? "ALARM: four fifths of the files this process may open are open; new connections are closed at once. "
               "Raise LimitNOFILE (ulimit -n), or find who opens so many connections"
             : "files can be opened again");
  files_run_out_ = run_out;
  const transport::GuardCounters guarded = transport::descriptor_guard_counters();
  const auto report = [&](std::uint64_t now_closed, std::uint64_t& reported, const char* why) {
    if (now_closed != reported && log_)
      log_(fmt::format("REFUSED: {} connections closed: {}", now_closed - reported, why));
    reported = now_closed;
  };
  report(guarded.out_of_descriptors, guarded_.out_of_descriptors,
         "four fifths of the files this process may open are open");
  report(guarded.too_many_bytes, guarded_.too_many_bytes, "their peers sent more than a handshake before it was done");
  report(guarded.displaced, guarded_.displaced, "their peers did not begin to talk, and many others have come since");
}

void Server::complete_status(wire::ServerStatus& status) const {
  const transport::RouterCounters& messages = router_.counters();
  status.messages_received = messages.received;
  status.messages_sent = messages.sent;
  status.answers_undeliverable = messages.peer_gone + messages.peer_full;
  status.messages_without_user = messages.without_user;
  if (const transport::AccessHandler* door = router_.access()) {
    status.connections_admitted = door->admitted();
    status.connections_refused = door->refused();
    status.admitting = door->alive();
  }
  const ProcessUse use = process_use();
  status.resident_bytes = use.resident_bytes;
  status.open_files = use.open_files;
  status.max_open_files = use.max_open_files;
}

void Server::end_if_failed() const {
  if (service_.failed())
    throw std::runtime_error(
        "requests can no longer be kept; the server ends, and the next one takes up what was kept");
}

void Server::run(int stop_fd, ServiceManager* manager) {
  manager_ = manager;
  std::optional<service::ReplyFrames> reply;  // the last one: its header is copied when the handler has returned
  const transport::Handler handler = [&](transport::Frames frames, std::string_view user) {
    service::Turn turn{};
    service::Caller caller = Access::caller(user);
    caller.is_revoked = access_.revoked(user);
    reply = service_.handle(frames, caller, &turn);
    if (!reply && turn != service::Turn::kAnswered)
      return transport::Answer(turn == service::Turn::kComputing ? transport::Answer::Kind::kKept
                                                                 : transport::Answer::Kind::kHeld);
    if (!reply) {
      end_if_failed();
      return transport::Answer();
    }
    transport::OutFrame header{std::as_bytes(std::span(reply->header)), nullptr};
    transport::OutFrame payload{reply->payload, std::move(reply->owner)};
    return reply->has_payload ? transport::Answer(std::move(header), std::move(payload))
                              : transport::Answer(std::move(header));
  };
  const auto work = [this] {
    const bool complete = service_.work();
    end_if_failed();
    return complete;
  };
  // A server program checks itself and its state directory periodically; an embedded server without a state directory
  // only waits.
  const bool sleeps = manager == nullptr && !store_;
  const transport::Pulse pulse = {.every_ms = sleeps ? -1 : kLookAfterMs,
                                  .beat =
                                      [&] {
                                        if (manager != nullptr) look_after();
                                        look_at_sessions();
                                        end_if_failed();
                                        checkpoint_if_due();
                                        return !service_.drained();
                                      },
                                  .busy = [this] { return service_.computing(); },
                                  .work = work,
                                  .wake = &wake_};
  router_.run(handler, stop_fd, pulse);
  ended_with_sessions_ = service_.drained() && service_.status().sessions != 0;
  if (manager != nullptr) manager->stopping();
  pollfd stop{.fd = stop_fd, .events = POLLIN, .revents = 0};
  if (::poll(&stop, 1, 0) > 0) {
    std::array<char, 128> asked;  // content of stop_fd, not used: the description of a signal, or an event counter
    static_cast<void>(::read(stop_fd, asked.data(), asked.size()) < 0);
  }
  // Requests that end soon are answered. A longer step ends with this server: the next one finds it in the journal.
  const std::uint64_t stopped_ns = monotonic_ns();
  while (service_.busy() && monotonic_ns() - stopped_ns < kFinishNs &&
         ::poll(&stop, 1, service_.computing() ? 0 : kLookAsideMs) == 0)
    if (work()) router_.answer_held(handler);
  service_.give_up();
  service_.begin_shutdown();
  router_.answer_waiting(handler, kRefusedAtStop);
  // A second stop request skips the last checkpoint, because the journal holds everything.
  service_.end_checkpoint(true);
  const bool in_haste = ::poll(&stop, 1, 0) > 0 && store_ && store_->journaling();
  if (store_ && store_->changed_since_checkpoint() && !in_haste) service_.checkpoint();
}

}  // namespace shearbus::server
