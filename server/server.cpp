#include "server/server.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <random>
#include <stdexcept>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "proto/wire/limits.hpp"

namespace shearbus::server {
namespace {

constexpr std::size_t kRefusedAtStop =
    4 * wire::kMaxSessions;  // more requests than this cannot wait without being sent again

std::uint64_t monotonic_ns() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

std::uint64_t random_epoch() {
  std::random_device source;
  const std::uint64_t epoch = (std::uint64_t{source()} << 32) | source();
  return epoch != 0 ? epoch : 1;
}

std::uint64_t three_quarters_of_memory() {
  const auto pages = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES));
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) / 4 * 3;
}

unsigned thread_count(unsigned wanted) {
  return wanted != 0 ? wanted : std::max(1U, std::thread::hardware_concurrency());
}

store::Durability durability_from(const std::string& word) {
  for (const auto known : {store::Durability::kNone, store::Durability::kProcess, store::Durability::kPower})
    if (word == store::name(known)) return known;
  throw std::invalid_argument("durability \"" + word + "\" is not known; use none, process or power");
}

service::ServiceOptions service_options(const ServerOptions& options, std::uint64_t epoch, const Log& log) {
  return {.epoch = epoch,
          .server_version = SHEARBUS_VERSION,
          .max_state_bytes = options.max_state_bytes != 0 ? options.max_state_bytes : three_quarters_of_memory(),
          .nodes_per_task = options.nodes_per_task,
          .now_ns = monotonic_ns,
          .log = log.info};
}

store::StoreOptions store_options(const ServerOptions& options, std::uint64_t epoch, const Log& log) {
  return {.durability = durability_from(options.durability),
          .epoch = epoch,
          .checkpoint_bytes = options.checkpoint_after_mb << 20,
          .accept_empty = options.accept_empty,
          .log = log.info};
}

}  // namespace

Server::Server(const ServerOptions& options, const Log& log) : Server(options, log, random_epoch()) {}

Server::Server(const ServerOptions& options, const Log& log, std::uint64_t epoch)
    : pool_(thread_count(options.threads)),
      storage_(options.state_dir.empty() ? nullptr : std::make_unique<store::PosixStorage>(options.state_dir)),
      store_(storage_ ? std::make_unique<store::Store>(*storage_, store_options(options, epoch, log)) : nullptr),
      service_(service_options(options, epoch, log), pool_, store_.get()),
      access_(options),
      router_({.max_frame_bytes = wire::kMaxPayloadBytes,
               .authorise = [this](const transport::Peer& peer) { return access_.judge(peer); },
               .ipc_for_others = access_.for_other_users(),
               .curve_secret_key = access_.secret_key(),
               .insecure_plaintext = options.insecure_plaintext,
               .log = log.debug,
               .log_access = log.info}),
      checkpoint_every_ns_(static_cast<std::uint64_t>(1e9 * options.checkpoint_every_s)),
      last_checkpoint_ns_(monotonic_ns()) {
  service_.recover();
}

// Between two requests: the answer to the last one is on its way.
void Server::checkpoint_if_due() {
  if (!store_ || !store_->changed_since_checkpoint()) return;
  const std::uint64_t now = monotonic_ns();
  if (!store_->checkpoint_due() && now - last_checkpoint_ns_ < checkpoint_every_ns_) return;
  service_.checkpoint();
  last_checkpoint_ns_ = monotonic_ns();
}

void Server::run(int stop_fd) {
  const transport::Handler handler = [this](transport::Frames frames, std::string_view user) {
    checkpoint_if_due();
    std::vector<transport::OutFrame> sent;
    if (auto reply = service_.handle(frames, Access::caller(user))) {
      auto header = std::make_shared<const std::string>(std::move(reply->header));
      sent.push_back({std::as_bytes(std::span(*header)), header});
      if (reply->has_payload) sent.push_back({reply->payload, std::move(reply->owner)});
    } else if (service_.failed()) {
      throw std::runtime_error(
          "requests can no longer be kept; the server ends, and the next one takes up what was kept");
    }
    return sent;
  };
  router_.run(handler, stop_fd);
  std::array<char, 128> asked;  // a signal's description, or the count of an event
  static_cast<void>(::read(stop_fd, asked.data(), asked.size()) < 0);
  service_.begin_shutdown();
  router_.answer_waiting(handler, kRefusedAtStop);
  // Asked a second time: the journal holds everything.
  pollfd again{.fd = stop_fd, .events = POLLIN, .revents = 0};
  const bool in_haste = ::poll(&again, 1, 0) > 0 && store_ && store_->journaling();
  if (store_ && store_->changed_since_checkpoint() && !in_haste) service_.checkpoint();
}

}  // namespace shearbus::server
