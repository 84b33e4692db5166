// shearbus-bench-exchange KIND NODES STEPS makes steps for a counter of instructions (instructions.py), in one thread
// and without a socket. KIND is `service`: a client's request is encoded, answered by the service and its reply
// decoded; or `shard`: the same steps by the shard alone. The difference is the cost of the bus without ZeroMQ.
#include <cstdio>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "proto/wire/codec.hpp"
#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace {

using namespace shearbus;
using support::ServiceHarness;

constexpr double kDt = 1e-9;
constexpr auto kStrategy = wire::Strategy::kForceDriven;

void by_service(const std::vector<std::uint64_t>& ids, int steps) {
  ServiceHarness harness;
  harness.ask(ServiceHarness::opening(support::force_scene(1), ids));
  wire::Request request = ServiceHarness::step(0, support::step_columns(kStrategy, ids, 0));
  for (int step = 1; step <= steps; ++step) {
    request.sequence = static_cast<std::uint64_t>(step);
    if (harness.ask(request).code() != wire::Code::kOk) std::abort();
  }
}

void by_shard(const std::vector<std::uint64_t>& ids, int steps) {
  shard::TaskPool pool(1);
  const service::SceneModel made = service::scene_model(support::force_scene(1));
  shard::Shard shard(physics::Model(made.options), ids,
                     std::vector<double>(ids.size(), made.options.initial_temperature), pool);
  const wire::Batch request = support::step_columns(kStrategy, ids, 0);
  wire::Batch reply = wire::Batch::of(wire::columns_of(kStrategy).reply, ids.size());
  const shard::StepColumns columns = service::step_columns(request, reply, kDt);
  shard::Rows rows;
  rows.all = true;
  for (int step = 0; step < steps; ++step) {
    shard.step(rows, *shard.operators(kDt), columns);
    shard.commit();
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: shearbus-bench-exchange service|shard NODES STEPS\n");
    return 2;
  }
  if (!__builtin_cpu_supports("avx2")) return 77;
  const auto ids = support::node_ids(static_cast<std::size_t>(std::atoi(argv[2])));
  (std::string_view(argv[1]) == "service" ? by_service : by_shard)(ids, std::atoi(argv[3]));
  return 0;
}
