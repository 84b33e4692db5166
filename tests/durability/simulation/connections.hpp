// Two kinds of client connections for the simulation: through the simulated network, and directly to a reference
// service.
#pragma once

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "tests/durability/simulation/world.hpp"
#include "tests/support/direct_connection.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::simulation {

using namespace std::chrono_literals;

class SimulatedConnection final : public Connection {
 public:
  explicit SimulatedConnection(World& world)
      : Connection({.reply_deadline = 20s, .retry_after = 100ms}), world_(world) {}

  void post(const wire::Request& request) override {
    posted_.clear();
    send(request, world_.new_socket());
  }
  // The network may deliver it before the request that was posted last.
  void post_behind(const wire::Request& request) override {
    if (!posted_.empty()) send(request, posted_.back().socket);
  }

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override {
    const auto last_moment = now() + deadline;
    if (!posted_.empty() && posted_.front().request_id != request.request_id) posted_.clear();
    bool under_way = !posted_.empty();
    do {
      if (!under_way) post(request);
      under_way = false;
      const std::uint64_t socket = posted_.front().socket;
      if (dies_next) break;
      while (auto got = world_.next(socket, std::min(last_moment, now() + options().retry_after))) {
        auto payload = std::make_shared<std::vector<std::byte>>(std::move(got->payload));
        Received received{.payload_frame = payload, .reply = {}};
        const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(got->header)), *payload};
        wire::decode(std::span(frames, wire::declares_payload(frames[0]) ? 2 : 1), received.reply);
        if (received.reply.request_id != request.request_id) continue;
        posted_.pop_front();
        if (!received.reply.status.ok()) {
          posted_.clear();
          throw Error(received.reply.status);
        }
        return received;
      }
    } while (now() < last_moment);
    posted_.clear();
    throw Error({.code = Code::kUnknownOutcome, .text = "no answer"});
  }
  void say(const wire::Request&) noexcept override {}
  Clock::time_point now() const override { return world_.now(); }
  void pause(std::chrono::milliseconds time) override { world_.next(0, now() + time); }

  bool dies_next = false;  // the client dies right after it has sent the next request

 private:
  struct Posted {
    std::uint64_t request_id;
    std::uint64_t socket;
  };

  void send(const wire::Request& request, std::uint64_t socket) {
    world_.transmit({.to_server = true,
                     .socket = socket,
                     .header = wire::encode_header(request),
                     .payload = support::bytes_of(request.batch)});
    posted_.push_back({request.request_id, socket});
  }

  World& world_;
  std::deque<Posted> posted_;  // requests that were sent and not answered yet, at most two
};

// A connection that calls a service directly: no message is lost, and the service never dies.
class DirectConnection final : public Connection {
 public:
  explicit DirectConnection(support::ServiceHarness& harness) : Connection({}), harness_(harness) {}
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    return support::received(harness_.ask(request));
  }
  void say(const wire::Request&) noexcept override {}

 private:
  support::ServiceHarness& harness_;
};

// Repeats the call until it is answered, at most 1000 times. Rethrows every refusal except that of a full disk.
template <typename Call>
auto insist(const Call& call) {
  for (int tries = 0;; ++tries) {
    try {
      return call();
    } catch (const Error& fault) {
      const bool again = fault.status().code == Code::kUnknownOutcome || fault.status().code == Code::kNoSpace;
      if (!again || tries == 1000) throw;
    }
  }
}

}  // namespace shearbus::simulation
