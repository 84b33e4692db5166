// Steps of the same rows by the service, without a socket, and by the shard alone. The difference is the cost of the bus
// without ZeroMQ.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "proto/wire/codec.hpp"
#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::bench {

constexpr double kDt = 1e-9;
constexpr auto kStrategy = wire::Strategy::kForceDriven;

// A client's request is encoded, answered by the service, and its reply decoded.
class ByService {
 public:
  explicit ByService(const std::vector<std::uint64_t>& ids, bool in_process = false)
      : caller_{.in_process = in_process},
        request_(support::ServiceHarness::step(0, support::step_columns(kStrategy, ids, 0))) {
    harness_.ask(support::ServiceHarness::opening(support::force_scene(1), ids), caller_);
  }
  void step() {
    ++request_.sequence;
    if (harness_.ask(request_, caller_).code() != wire::Code::kOk) std::abort();
  }

 private:
  support::ServiceHarness harness_;
  service::Caller caller_;
  wire::Request request_;
};

// The same with a server in the client's process.
class Embedded : public ByService {
 public:
  explicit Embedded(const std::vector<std::uint64_t>& ids) : ByService(ids, true) {}
};

class ByShard {
 public:
  explicit ByShard(const std::vector<std::uint64_t>& ids)
      : made_(service::scene_model(support::force_scene(1))),
        shard_(physics::Model(made_.options), ids, std::vector<double>(ids.size(), made_.options.initial_temperature),
               pool_),
        request_(support::step_columns(kStrategy, ids, 0)),
        reply_(wire::Batch::of(wire::columns_of(kStrategy).reply, ids.size())),
        columns_(service::step_columns(request_, reply_, kDt)) {
    rows_.all = true;
  }
  ByShard(const ByShard&) = delete;
  ByShard& operator=(const ByShard&) = delete;
  void step() {
    shard_.step(rows_, *shard_.operators(kDt), columns_);
    shard_.commit();
  }

 private:
  shard::TaskPool pool_{1};
  service::SceneModel made_;
  shard::Shard shard_;
  wire::Batch request_;
  wire::Batch reply_;
  shard::StepColumns columns_;
  shard::Rows rows_;
};

}  // namespace shearbus::bench
