// Clients and server in one thread, on a network that loses, repeats, delays and reorders, and a disk that fails or
// dies with the machine at any of its calls. Everything follows from a seed. The reference model is a server to which
// nothing ever happens: each call that is answered is made there as well, and the two answers must have the same bits.
// So a request that is lost after its answer (P1), run twice (P2), changes something though refused (P3), or comes from
// the dead (P4), a damaged checkpoint that is loaded (P5) and a replay that differs (P6) all show as a difference at
// the next step.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <map>
#include <random>
#include <set>

#include "client/src/connection.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::DurableServer;
using support::MemoryStorage;
using wire::Strategy;
using Clock = Connection::Clock;

struct Packet {
  bool to_server = false;
  std::uint64_t socket = 0;
  std::string header;
  std::vector<std::byte> payload;
};

struct Tally {
  std::uint64_t calls = 0, crashes = 0, dropped = 0, repeated = 0, disk_faults = 0, damaged = 0, successors = 0,
                checkpoints = 0;
};

class World {
 public:
  World(unsigned seed, Tally& tally)
      : random(seed),
        durability_(seed % 2 == 0 ? store::Durability::kPower : store::Durability::kProcess),
        tally_(tally) {
    start();
  }

  bool chance(int one_in) { return random() % static_cast<unsigned>(one_in) == 0; }
  Clock::time_point now() const { return now_; }
  std::uint64_t new_socket() { return ++last_socket_; }

  void transmit(Packet packet) {
    if (chance(12)) {
      ++tally_.dropped;
      return;
    }
    const auto delay = [&] { return std::chrono::milliseconds(chance(20) ? random() % 2000 : random() % 5); };
    if (chance(12)) {
      ++tally_.repeated;
      network_.emplace(now_ + delay(), packet);
    }
    network_.emplace(now_ + delay(), std::move(packet));
  }

  // The next packet for this socket; nothing where `until` comes first.
  std::optional<Packet> next(std::uint64_t socket, Clock::time_point until) {
    while (!network_.empty() && network_.begin()->first <= until) {
      now_ = std::max(now_, network_.begin()->first);
      Packet packet = std::move(network_.extract(network_.begin()).mapped());
      if (packet.to_server)
        deliver(packet);
      else if (packet.socket == socket)
        return packet;
    }
    now_ = std::max(now_, until);
    return std::nullopt;
  }

  std::mt19937 random;

 private:
  void start() {
    static constexpr int kFaults[] = {0, 0, EIO, ENOSPC};  // 0: the machine dies
    if (chance(2)) {
      disk_.plan({.at_call = 1 + random() % 80, .code = kFaults[random() % 4]});
      ++tally_.disk_faults;
    }
    try {
      server_ = std::make_unique<DurableServer>(disk_, durability_, ++epoch_ << 32, 1 + random() % 2);
    } catch (const store::StorageError&) {
      crash();  // during recovery, too
    }
    if (disk_.dead()) crash();
  }

  void crash() {
    ++tally_.crashes;
    server_.reset();
    if (durability_ == store::Durability::kPower)
      disk_.die_of_power(random);
    else
      disk_.die_of_process();
    // Connections end with the server, and with them what was on its way to it.
    std::erase_if(network_, [](const auto& entry) { return entry.second.to_server; });
    if (chance(6)) damage_a_checkpoint();
    back_at_ = now_ + std::chrono::milliseconds(random() % 400);
  }

  // The newest, where a sound one stands before it.
  void damage_a_checkpoint() {
    std::vector<std::string> sound;
    for (const std::string& name : disk_.names())
      if (name.starts_with("checkpoint-") && name.ends_with(".h5") && !damaged_.contains(name)) sound.push_back(name);
    if (sound.size() < 2) return;
    auto& bytes = disk_.bytes(sound.back());
    bytes[random() % bytes.size()] ^= static_cast<std::byte>(1U << random() % 8);
    damaged_.insert(sound.back());
    ++tally_.damaged;
  }

  void deliver(const Packet& packet) {
    if (!server_ && now_ >= back_at_) start();
    if (!server_) return;
    const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(packet.header)), packet.payload};
    auto answer = server_->try_ask(std::span(frames, packet.payload.empty() ? 1 : 2));
    if (disk_.dead() || server_->service.failed() || chance(60)) return crash();  // the answer, if any, is never sent
    if (answer)
      transmit(
          {.to_server = false, .socket = packet.socket, .header = answer->frames.header, .payload = answer->payload()});
    if (chance(12) && server_->service.checkpoint()) ++tally_.checkpoints;
    if (disk_.dead()) crash();
  }

  store::Durability durability_;
  Tally& tally_;
  MemoryStorage disk_;
  std::set<std::string> damaged_;
  std::unique_ptr<DurableServer> server_;  // null while it is down
  std::uint64_t epoch_ = 0;
  std::uint64_t last_socket_ = 0;
  Clock::time_point now_{};
  Clock::time_point back_at_{};
  std::multimap<Clock::time_point, Packet> network_;
};

class SimulatedConnection final : public Connection {
 public:
  explicit SimulatedConnection(World& world)
      : Connection({.reply_deadline = 20s, .retry_after = 100ms}), world_(world) {}

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override {
    const Packet packet{.to_server = true,
                        .socket = 0,
                        .header = wire::encode_header(request),
                        .payload = support::bytes_of(request.batch)};
    const auto last_moment = now() + deadline;
    do {
      Packet sent = packet;
      const std::uint64_t socket = sent.socket = world_.new_socket();
      world_.transmit(std::move(sent));
      if (dies_next) break;
      while (auto got = world_.next(socket, std::min(last_moment, now() + options().retry_after))) {
        auto payload = std::make_shared<std::vector<std::byte>>(std::move(got->payload));
        Received received{.payload_frame = payload, .reply = {}};
        const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(got->header)), *payload};
        wire::decode(std::span(frames, payload->empty() ? 1 : 2), received.reply);
        if (received.reply.request_id != request.request_id) continue;
        if (!received.reply.status.ok()) throw Error(received.reply.status);
        return received;
      }
    } while (now() < last_moment);
    throw Error({.code = Code::kUnknownOutcome, .text = "no answer"});
  }
  void say(const wire::Request&) noexcept override {}
  Clock::time_point now() const override { return world_.now(); }
  void pause(std::chrono::milliseconds time) override { world_.next(0, now() + time); }

  bool dies_next = false;  // the next call is sent, and its client is no more

 private:
  World& world_;
};

// A way to a service to which nothing happens.
class DirectConnection final : public Connection {
 public:
  DirectConnection() : Connection({}) {}
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    auto answer = std::make_shared<support::Answer>(harness_.ask(request));
    Received received{.payload_frame = answer, .reply = {}};
    const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(answer->frames.header)),
                                                  answer->frames.payload};
    wire::decode(std::span(frames, answer->frames.has_payload ? 2 : 1), received.reply);
    if (!received.reply.status.ok()) throw Error(received.reply.status);
    return received;
  }
  void say(const wire::Request&) noexcept override {}

 private:
  support::ServiceHarness harness_;
};

// The call's answer, however often it takes to get it.
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

class Host {
 public:
  Host(World& world, Tally& tally, unsigned number)
      : world_(world),
        tally_(tally),
        strategy_(number % 2 == 0 ? Strategy::kVelocityDriven : Strategy::kForceDriven),
        nodes_(support::node_ids(3 + 6 * number)),
        connection_(std::make_shared<SimulatedConnection>(world)),
        client_(insist([&] { return Client(std::shared_ptr<Connection>(connection_)); })),
        reference_client_(std::make_shared<DirectConnection>()),
        session_(insist([&] { return client_.open(support::scene_of(strategy_), nodes_); })),
        reference_(reference_client_.open(support::scene_of(strategy_), nodes_)) {}

  void act() {
    ++tally_.calls;
    if (world_.chance(10)) return die_and_be_succeeded();
    if (world_.chance(12)) return ask_nonsense();
    if (world_.chance(12)) {
      const std::string name = "dump " + std::to_string(steps_);
      last_mark_ = name;
      ASSERT_EQ(insist([&] { return session_.mark(name).names; }), reference_.mark(name).names);
      return;
    }
    if (!last_mark_.empty() && world_.chance(20)) {
      ASSERT_EQ(insist([&] { return session_.rollback_to(last_mark_); }), reference_.rollback_to(last_mark_));
      return;
    }
    const int number = steps_++;
    const unsigned choice = world_.random() % 4;
    if (choice == 0) {
      step(number, wire::Mode::kAdvance);
    } else {
      step(number, wire::Mode::kTrial);
      if (choice == 1) {
        ASSERT_EQ(insist([&] { return session_.commit(); }), reference_.commit());
      }
      if (choice == 2) {
        ASSERT_EQ(insist([&] { return session_.rollback(); }), reference_.rollback());
      }
      if (choice == 3) step(number + 1, wire::Mode::kTrial, true);
    }
  }
  void close() {
    const auto totals = insist([&] { return session_.close(); });
    const auto expected = reference_.close();
    ASSERT_EQ(totals.requests, expected.requests);
    ASSERT_EQ(totals.node_steps, expected.node_steps);
  }

 private:
  const StepResult& made(Session& session, const Batch& columns, wire::Mode mode, bool commit_previous) {
    const StepOptions options{.dt_s = 1e-9, .commit_previous = commit_previous};
    return mode == wire::Mode::kAdvance ? session.advance(columns, options) : session.trial(columns, options);
  }
  void step(int number, wire::Mode mode, bool commit_previous = false) {
    const Batch columns = support::step_columns(strategy_, nodes_, number);
    const StepResult& expected = made(reference_, columns, mode, commit_previous);
    const StepResult* answer = insist([&] { return &made(session_, columns, mode, commit_previous); });
    ASSERT_EQ(answer->upscale().state_version, expected.upscale().state_version);
    ASSERT_EQ(answer->upscale().nodes, expected.upscale().nodes);
    const auto bits = [](std::span<const double> column) { return std::as_bytes(column); };
    for (const auto& [a, b] : {std::pair{bits(answer->shear_stress_pa()), bits(expected.shear_stress_pa())},
                               {bits(answer->interface_temperature_k()), bits(expected.interface_temperature_k())},
                               {bits(answer->sliding_velocity_m_per_s()), bits(expected.sliding_velocity_m_per_s())},
                               {bits(answer->friction_heat_j_per_m2()), bits(expected.friction_heat_j_per_m2())}})
      ASSERT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << "step " << number;
  }

  void ask_nonsense() {
    Batch columns = support::step_columns(strategy_, nodes_, 0);
    columns.f64(Field::kPressure)[1] = std::numeric_limits<double>::infinity();
    try {
      insist([&] { return &session_.advance(columns, {.dt_s = 1e-9}); });
      FAIL() << "nonsense was answered";
    } catch (const Error& fault) {
      ASSERT_EQ(fault.status().code, Code::kInvalidValue) << fault.what();
    }
  }

  // The client is gone right after it has sent a step; its successor is told whether that step was run, and nothing
  // that the dead one sent is run from then on.
  void die_and_be_succeeded() {
    ++tally_.successors;
    const Batch columns = support::step_columns(strategy_, nodes_, steps_++);
    const std::uint64_t before = session_.last_sequence();
    connection_->dies_next = true;
    try {
      session_.advance(columns, {.dt_s = 1e-9});
    } catch (const Error&) {
    }
    const Session::Ticket ticket = session_.ticket();
    session_.leave();
    connection_ = std::make_shared<SimulatedConnection>(world_);
    client_ = insist([&] { return Client(std::shared_ptr<Connection>(connection_)); });
    session_ = insist([&] { return client_.resume(ticket); });
    ASSERT_EQ(session_.node_ids(), nodes_);
    ASSERT_LE(session_.last_sequence(), before + 1);
    ASSERT_GE(session_.last_sequence(), before);
    if (session_.last_sequence() == before + 1) reference_.advance(columns, {.dt_s = 1e-9});
  }

  World& world_;
  Tally& tally_;
  Strategy strategy_;
  std::vector<std::uint64_t> nodes_;
  std::shared_ptr<SimulatedConnection> connection_;
  Client client_;
  Client reference_client_;
  Session session_;
  Session reference_;
  int steps_ = 0;
  std::string last_mark_;
};

void simulate(unsigned seed, Tally& tally) {
  World world(seed, tally);
  std::vector<std::unique_ptr<Host>> hosts;
  for (unsigned i = 0; i < 2; ++i) hosts.push_back(std::make_unique<Host>(world, tally, i));
  for (int i = 0; i < 25; ++i) {
    hosts[world.random() % hosts.size()]->act();
    if (testing::Test::HasFatalFailure()) return;
  }
  for (const auto& host : hosts) host->close();
}

// SHEARBUS_SEED runs one seed, SHEARBUS_SEEDS so many.
TEST(Simulation, WhateverHappensTheAnswersAreThoseOfAServerToWhichNothingDoes) {
  const char* one = std::getenv("SHEARBUS_SEED");
  const char* many = std::getenv("SHEARBUS_SEEDS");
  const unsigned first = one != nullptr ? static_cast<unsigned>(std::atoi(one)) : 1;
  const unsigned count = one != nullptr ? 1 : many != nullptr ? static_cast<unsigned>(std::atoi(many)) : 2000;
  Tally tally;
  for (unsigned seed = first; seed < first + count; ++seed) {
    SCOPED_TRACE("SHEARBUS_SEED=" + std::to_string(seed));
    try {
      simulate(seed, tally);
    } catch (const std::exception& fault) {
      ADD_FAILURE() << fault.what();
    }
    if (HasFailure()) break;
  }
  std::cout << count << " seeds: " << tally.calls << " calls, " << tally.crashes << " crashes, " << tally.disk_faults
            << " servers with a planned disk fault, " << tally.checkpoints << " checkpoints, " << tally.damaged
            << " of them damaged, " << tally.dropped << " messages lost, " << tally.repeated << " repeated, "
            << tally.successors << " clients died; answers that differ: " << (HasFailure() ? "SOME" : "0") << "\n";
  EXPECT_GT(tally.crashes, count / 2);
}

}  // namespace
}  // namespace shearbus
