// shearbus-bench-durability measures the cost of sessions that survive the server: round trips of a step over ipc, with
// one server for each level of durability. The servers take turns, so that other load of the machine affects all levels
// alike. The levels are:
//
//   volatile  no state directory
//   process   a step is in the journal before it is answered
//   power     the journal is also synced to the disk before the answer
//
// Prints for each strategy and number of nodes one line with the median time at each level and its ratio to the median
// of `volatile`.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace {

using namespace shearbus;
using Clock = std::chrono::steady_clock;
using Microseconds = std::chrono::duration<double, std::micro>;

constexpr double kDt = 1e-9;
constexpr int kRounds = 600;

struct Arm {
  explicit Arm(const char* durability, const v1::Scene& scene, std::span<const std::uint64_t> nodes) {
    server::ServerOptions options;
    options.threads = 1;
    if (durability != nullptr) {
      options.state_dir = (directory.path() / "state").string();
      options.durability = durability;
    }
    server = std::make_unique<support::RunningServer>(options);
    client = std::make_unique<Client>(server->client_options());
    session = std::make_unique<Session>(client->open(support::text_of(scene), "scene", nodes));
  }

  support::ScratchDirectory directory;
  std::unique_ptr<support::RunningServer> server;
  std::unique_ptr<Client> client;
  std::unique_ptr<Session> session;
  std::vector<double> us;
};

double median(std::vector<double>& values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

void measure(const char* label, const v1::Scene& scene, std::size_t nodes) {
  const auto ids = support::node_ids(nodes);
  std::vector<std::unique_ptr<Arm>> arms;
  for (const char* durability : {static_cast<const char*>(nullptr), "process", "power"})
    arms.push_back(std::make_unique<Arm>(durability, scene, ids));
  for (int round = 0; round < kRounds; ++round) {
    const auto request = support::step_columns(support::strategy_of(scene), ids, round);
    for (const auto& arm : arms) {
      const auto started = Clock::now();
      arm->session->advance(request, {.dt_s = kDt});
      arm->us.push_back(Microseconds(Clock::now() - started).count());
    }
  }
  const double first = median(arms[0]->us);
  const double process = median(arms[1]->us);
  const double power = median(arms[2]->us);
  std::printf("%-32s %8zu %12.1f %12.1f %8.3f %12.1f %8.2f\n", label, nodes, first, process, process / first, power,
              power / first);
}

}  // namespace

int main() {
  std::printf("%-32s %8s %12s %12s %8s %12s %8s\n", "scene", "nodes", "volatile, us", "process, us", "ratio",
              "power, us", "ratio");
  for (const std::size_t nodes : {100u, 1'000u, 10'000u}) {
    measure("force-driven, 24 cells", support::force_scene(), nodes);
    measure("velocity-driven, 24 cells", support::velocity_scene(), nodes);
  }
  return 0;
}
