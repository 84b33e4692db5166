// A service with a store, without sockets. A second DurableServer on the same disk recovers the states of the first.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/wire/codec.hpp"
#include "server/service/service.hpp"
#include "server/store/store.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::support {

struct DurableServer {
  explicit DurableServer(store::Storage& disk, store::Durability durability = store::Durability::kProcess,
                         std::uint64_t epoch = 77, unsigned threads = 1,
                         std::uint64_t max_state_bytes = std::uint64_t{8} << 30, double slice_work = 0.0)
      : store(disk, {.durability = durability, .epoch = epoch}),
        pool(threads),
        service({.epoch = epoch,
                 .server_version = "test",
                 .max_state_bytes = max_state_bytes,
                 .max_sessions = std::size_t{1} << 16,
                 .max_sessions_per_user = std::size_t{1} << 16,
                 .nodes_per_task = 4,
                 .slice_work = slice_work,
                 .now_ns = [this] { return ++clock; },
                 .log = [this](const std::string& line) { log.push_back(line); }},
                pool, &store) {
    service.recover();
  }

  // Returns the service's answer, or nothing if the service does not answer, with `turn` perhaps not yet.
  std::optional<Answer> try_ask(service::Frames frames, const service::Caller& caller = {},
                                service::Turn* turn = nullptr) {
    auto answered = service.handle(frames, caller, turn);
    if (!answered) return std::nullopt;
    return decoded(std::move(*answered), caller.in_process);
  }
  Answer ask(const wire::Request& request, const service::Caller& caller = {}) {
    const std::string header = wire::encode_header(request);
    const std::span<const std::byte> views[2] = {std::as_bytes(std::span(header)), request.batch.bytes()};
    auto answer = try_ask(std::span(views, request.batch.columns().empty() ? 1 : 2), caller);
    if (!answer) throw std::runtime_error("the service did not answer");
    return std::move(*answer);
  }

  std::uint64_t clock = 0;
  std::vector<std::string> log;
  store::Store store;
  shard::TaskPool pool;
  service::Service service;
};

}  // namespace shearbus::support

namespace shearbus::service {
using support::DurableServer;
using support::MemoryStorage;
}  // namespace shearbus::service
