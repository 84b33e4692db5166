#include "server/server.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <random>
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

service::ServiceOptions service_options(const ServerOptions& options, const Log& log) {
  return {.epoch = random_epoch(),
          .server_version = SHEARBUS_VERSION,
          .max_state_bytes = options.max_state_bytes != 0 ? options.max_state_bytes : three_quarters_of_memory(),
          .nodes_per_task = options.nodes_per_task,
          .now_ns = monotonic_ns,
          .log = log.info};
}

}  // namespace

Server::Server(const ServerOptions& options, const Log& log)
    : pool_(thread_count(options.threads)),
      service_(service_options(options, log), pool_),
      router_({.max_frame_bytes = wire::kMaxPayloadBytes,
               .insecure_plaintext = options.insecure_plaintext,
               .log = log.debug}) {}

void Server::run(int stop_fd) {
  const transport::Handler handler = [this](transport::Frames frames) {
    std::vector<transport::OutFrame> sent;
    if (auto reply = service_.handle(frames)) {
      auto header = std::make_shared<const std::string>(std::move(reply->header));
      sent.push_back({std::as_bytes(std::span(*header)), header});
      if (reply->has_payload) sent.push_back({reply->payload, std::move(reply->owner)});
    }
    return sent;
  };
  router_.run(handler, stop_fd);
  service_.begin_shutdown();
  router_.answer_waiting(handler, kRefusedAtStop);
}

}  // namespace shearbus::server
