// shearbus-bench-durability measures the cost of sessions that survive the server: round trips of a step over ipc, with
// one server for each level of durability. The servers take turns, so that other load of the machine affects all levels
// alike. The levels are:
//
//   volatile  no state directory
//   record    no state directory, and an event log of what was asked and answered (--record)
//   process   a step is in the journal before it is answered
//   power     the journal is also synced to the disk before the answer
//
// Prints for each strategy and number of nodes one line with the median time at each level and its ratio to the median
// of `volatile`; with an argument it also writes them to this file as JSON. A second argument is the number of rounds.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace {

using namespace shearbus;
using Clock = std::chrono::steady_clock;
using Microseconds = std::chrono::duration<double, std::micro>;

constexpr double kDt = 1e-9;
constexpr const char* kLevels[] = {"volatile", "record", "process", "power"};

struct Arm {
  Arm(const std::string& level, const v1::Scene& scene, std::span<const std::uint64_t> nodes) {
    server::ServerOptions options;
    options.threads = 1;
    if (level == "record") {
      options.record_dir = (directory.path() / "record").string();
    } else if (level != "volatile") {
      options.state_dir = (directory.path() / "state").string();
      options.durability = level;
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

nlohmann::json measure(const char* label, const v1::Scene& scene, std::size_t nodes, int rounds) {
  const auto ids = support::node_ids(nodes);
  std::vector<std::unique_ptr<Arm>> arms;
  for (const char* level : kLevels) arms.push_back(std::make_unique<Arm>(level, scene, ids));
  for (int round = 0; round < rounds; ++round) {
    const auto request = support::step_columns(support::strategy_of(scene), ids, round);
    for (const auto& arm : arms) {
      const auto started = Clock::now();
      arm->session->advance(request, {.dt_s = kDt});
      arm->us.push_back(Microseconds(Clock::now() - started).count());
    }
  }
  nlohmann::json found = {{"scene", label}, {"nodes", nodes}, {"rounds", rounds}};
  const double first = median(arms.front()->us);
  std::printf("%-28s %8zu %12.1f", label, nodes, first);
  for (std::size_t i = 0; i < arms.size(); ++i) {
    const double us = median(arms[i]->us);
    found[std::string(kLevels[i]) + "_us"] = us;
    if (i > 0) std::printf(" %12.1f %7.3f", us, us / first);
  }
  std::printf("\n");
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 600;
  std::printf("%-28s %8s %12s", "scene", "nodes", "volatile, us");
  for (const char* level : {"record", "process", "power"}) std::printf(" %8s, us %7s", level, "ratio");
  std::printf("\n");
  nlohmann::json all;
  for (const std::size_t nodes : {100u, 1'000u, 10'000u}) {
    all.push_back(measure("force-driven, 24 cells", support::force_scene(), nodes, rounds));
    all.push_back(measure("velocity-driven, 24 cells", support::velocity_scene(), nodes, rounds));
  }
  if (argc > 1) std::ofstream(argv[1]) << all.dump(2) << "\n";
  return 0;
}
