// The environment of a simulated server: a clock, a network that loses, repeats, delays and reorders packets, and a
// disk that fails at any of its calls or whose machine dies during the call. The seed determines everything.
#pragma once

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/src/client.hpp"
#include "client/src/connection.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"

namespace shearbus::simulation {

using support::DurableServer;
using support::MemoryStorage;
using Clock = Connection::Clock;

struct Packet {
  bool to_server = false;
  std::uint64_t socket = 0;
  std::string header;
  std::vector<std::byte> payload;
};

// Counts of the events of a simulation, for its report.
struct Tally {
  std::uint64_t calls = 0, crashes = 0, dropped = 0, repeated = 0, disk_faults = 0, damaged = 0, successors = 0,
                checkpoints = 0, node_changes = 0, moved = 0, refused = 0, held = 0;
};

class World {
 public:
  // last_epoch: before the first server's; differs among servers of one client. claims_kill: the server dies of one in
  // so many claims that it has run, before their answer.
  World(unsigned seed, Tally& tally, std::uint64_t last_epoch = 0, int claims_kill = kRequestsKill);

  bool chance(int one_in) { return random() % static_cast<unsigned>(one_in) == 0; }
  Clock::time_point now() const { return now_; }
  std::uint64_t new_socket() { return ++last_socket_; }

  // Gives the packet to the network, which may lose it, deliver it twice or delay it.
  void transmit(Packet packet);
  // Returns the next packet for `socket`, or nothing if the time `until` comes first.
  std::optional<Packet> next(std::uint64_t socket, Clock::time_point until);

  std::mt19937 random;

 private:
  static constexpr int kRequestsKill = 60;

  void start();
  void crash();
  void damage_a_checkpoint();
  void deliver(Packet packet);
  bool ask(const Packet& packet);
  void compute();

  store::Durability durability_;
  Tally& tally_;
  MemoryStorage disk_;
  std::set<std::string> damaged_;
  std::unique_ptr<DurableServer> server_;  // null while no server runs
  std::uint64_t epoch_;
  int claims_kill_;
  std::uint64_t last_socket_ = 0;
  Clock::time_point now_{};
  Clock::time_point back_at_{};
  std::multimap<Clock::time_point, Packet> network_;
  std::list<Packet> held_;  // requests that the server answers later, as a router holds them
};

}  // namespace shearbus::simulation
