// Steps of more rows than a message holds, over a real socket. The client divides them into parts.
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using wire::Strategy;

// Above 200,000; a million in the long tests.
std::size_t nodes_wanted() {
  const char* text = std::getenv("SHEARBUS_LARGE_NODES");
  return text != nullptr ? std::strtoull(text, nullptr, 10) : 203'000;
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which have memory of their own
// Resident memory of a process  [B].
double resident(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/statm");
  double size = 0.0, pages = 0.0;
  file >> size >> pages;
  return pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

// The memory that deploy/SCALE.md promises for a session beyond an empty server: the states, and of the rows of the
// largest message the request, the kept reply and one earlier reply; in parts also the request that comes ahead and
// memory for one that the next one will need.
double promised(std::size_t nodes, std::uint64_t bytes_per_node) {
  constexpr double kReply = 42.0, kRequest = 56.0;
  const double rows = static_cast<double>(std::min(nodes, wire::kMaxRowsPerMessage));
  const double requests = nodes > wire::kMaxRowsPerMessage ? 3 : 1;
  return static_cast<double>(nodes) * (static_cast<double>(bytes_per_node) - kReply) +
         rows * (2 * kReply + requests * kRequest);
}

TEST(LargeSteps, TakeTheMemoryThatTheFormulaPromises) {
  const support::ScratchDirectory scratch;
  support::ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc(), .check_closure = CheckClosure::kOff});
  client.server_status();
  const double empty = resident(server.process().id());
  const auto nodes = support::node_ids(std::max(nodes_wanted(), 2 * wire::kMaxRowsPerMessage));  // in full parts
  Session session = client.open(support::text_of(support::force_scene(20)), "scene", nodes);
  const Batch columns = support::step_columns(Strategy::kForceDriven, nodes, 0);
  for (int step = 0; step < 3; ++step) session.advance(columns, {.dt_s = 1e-9});
  EXPECT_NEAR((resident(server.process().id()) - empty) / promised(nodes.size(), session.opened.bytes_per_node), 1.0,
              0.05);
}
#endif

TEST(LargeSteps, AreDividedAndCommittedAsOne) {
  const support::ScratchDirectory scratch;
  support::ServerProcess server({"--bind", scratch.ipc()});
  ASSERT_TRUE(server.ready()) << server.log();
  Client client({.endpoint = scratch.ipc(), .check_closure = CheckClosure::kOff});
  const auto nodes = support::node_ids(nodes_wanted());
  const std::vector<std::uint64_t> few = {nodes[0], nodes[199'999], nodes[200'000], nodes.back()};
  const std::string scene = support::text_of(support::force_scene(4));
  Session large = client.open(scene, "scene", nodes);
  Session small = client.open(scene, "scene", few);
  const auto same = [&](const StepResult& a, const StepResult& b) {
    for (std::size_t row = 0; row < few.size(); ++row) {
      const auto at = static_cast<std::size_t>(few[row] - nodes[0]);
      ASSERT_EQ(a.shear_stress_pa()[at], b.shear_stress_pa()[row]) << row;
      ASSERT_EQ(a.interface_temperature_k()[at], b.interface_temperature_k()[row]) << row;
      ASSERT_EQ(a.batch().u8(Field::kOutcome)[at], b.batch().u8(Field::kOutcome)[row]) << row;
    }
  };
  const auto columns = [&](std::span<const std::uint64_t> ids, int step) {
    return support::step_columns(Strategy::kForceDriven, ids, step);
  };
  const StepResult& first = large.advance(columns(nodes, 0), {.dt_s = 1e-9});
  ASSERT_EQ(first.upscale().nodes, nodes.size());
  ASSERT_EQ(first.upscale().state_version, 1u);
  same(first, small.advance(columns(few, 0), {.dt_s = 1e-9}));
  const Batch second = columns(nodes, 1);
  large.start(second, {.dt_s = 1e-9, .mode = wire::Mode::kTrial});
  same(large.finish(), small.trial(columns(few, 1), {.dt_s = 1e-9}));
  EXPECT_EQ(large.commit(), 2u);
  EXPECT_EQ(large.rollback(), 2u);
  EXPECT_EQ(large.close().node_steps, 2 * nodes.size());
}

}  // namespace
}  // namespace shearbus
