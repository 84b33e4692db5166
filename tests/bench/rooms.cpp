// Cost of each room that a step passes, next to what one would write first. Benchmarks of one name before the slash are
// compared: `twin` and `packed` are the yardsticks.
//
//   kernel   a step of the layer (60 graded cells, 100 m/s, 11.2 GPa, the first 50 ns): tile, the server's solver of eight
//            nodes; twin, the scalar solver of the reference, one node after the other
//   codec    the frames of a step and of its answer, written and read: columns, as on the wire, with checksums; packed,
//            protobuf messages of packed repeated doubles, reused, from and to arrays of the host
//   step     a step of a scene of one cell: shard, the states alone; service, with codec, checks and session
//
// items_per_second counts node-steps, of the codec rows. Run by tests/bench/run.py.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <span>
#include <string>

#include "bench/packed.pb.h"
#include "server/physics/reference/advance_one.hpp"
#include "tests/bench/exchange.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::bench {
namespace {

using physics::kLanes;
using physics::Strategy;

constexpr int kLayerSteps = 50;

physics::ModelOptions layer(Strategy strategy) {
  return testing::graded(testing::paper_options(strategy));
}

void tile(benchmark::State& state, Strategy strategy) {
  testing::Rig rig(layer(strategy));
  rig.set_all(100.0, 11.2e9);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703 * 2.5e-6;
    rig.inputs.mass_hard[l] = 7900 * 2.5e-6;
    rig.inputs.velocity_jump[l] += l;
  }
  const std::vector<double> start = rig.committed;
  for (auto _ : state) {
    rig.committed = start;
    for (int n = 0; n < kLayerSteps; ++n) rig.step(kDt);
    benchmark::DoNotOptimize(rig.outputs);
  }
  state.SetItemsProcessed(state.iterations() * kLayerSteps * kLanes);
}

void twin(benchmark::State& state, Strategy strategy) {
  const physics::ModelOptions options = layer(strategy);
  const physics::reference::NodeInputs inputs{
      .velocity_jump = 100.0, .pressure = 11.2e9, .mass_soft = 2703 * 2.5e-6, .mass_hard = 7900 * 2.5e-6};
  for (auto _ : state) {
    physics::reference::NodeState node = physics::reference::initial_state(options);
    for (int n = 0; n < kLayerSteps; ++n)
      benchmark::DoNotOptimize(physics::reference::advance_one(options, kDt, inputs, node));
  }
  state.SetItemsProcessed(state.iterations() * kLayerSteps);
}

wire::Batch answer_columns(std::size_t nodes) {
  wire::Batch batch = wire::Batch::of(wire::columns_of(kStrategy).reply, nodes);
  for (const wire::Field field : wire::columns_of(kStrategy).reply)
    if (wire::element_of(field) == wire::Element::kFloat64)
      for (std::size_t row = 0; row < nodes; ++row) batch.f64(field)[row] = 1e6 + static_cast<double>(row);
  return batch;
}

// Writes a message and reads its frames.
template <class Message>
void pass(const Message& sent) {
  const std::string header = wire::encode_header(sent);
  const std::span<const std::byte> frames[2] = {std::as_bytes(std::span(header)), sent.batch.bytes()};
  Message read;
  wire::decode(frames, read);
  benchmark::DoNotOptimize(read);
}

void columns(benchmark::State& state) {
  const auto nodes = static_cast<std::size_t>(state.range(0));
  wire::Request step = support::ServiceHarness::step(1, support::step_columns(kStrategy, support::node_ids(nodes), 0));
  wire::Reply answer;
  answer.request_id = step.request_id;
  answer.session_id = step.session_id;
  answer.sequence = 1;
  answer.body = wire::Upscale{};
  answer.batch = answer_columns(nodes);
  for (auto _ : state) {
    pass(step);
    pass(answer);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

using Numbers = google::protobuf::RepeatedField<double>;
using wire::Field;

void fill(Numbers& to, std::span<const double> from) {
  to.Clear();
  to.Add(from.begin(), from.end());
}
void take(std::span<double> to, const Numbers& from) {
  std::copy(from.begin(), from.end(), to.begin());
}

void packed(benchmark::State& state) {
  const auto nodes = static_cast<std::size_t>(state.range(0));
  const wire::Batch step = support::step_columns(kStrategy, support::node_ids(nodes), 0);
  const wire::Batch answer = answer_columns(nodes);
  wire::Batch step_read = support::step_columns(kStrategy, support::node_ids(nodes), 0);
  wire::Batch answer_read = answer_columns(nodes);
  PackedStep sent_step, read_step;
  PackedAnswer sent_answer, read_answer;
  std::string bytes;
  for (auto _ : state) {
    sent_step.set_dt_s(kDt);
    fill(*sent_step.mutable_velocity_jump(), step.f64(Field::kVelocityJump));
    fill(*sent_step.mutable_pressure(), step.f64(Field::kPressure));
    fill(*sent_step.mutable_stress_soft(), step.f64(Field::kStressSoft));
    fill(*sent_step.mutable_stress_hard(), step.f64(Field::kStressHard));
    fill(*sent_step.mutable_mass_soft(), step.f64(Field::kMassSoft));
    fill(*sent_step.mutable_mass_hard(), step.f64(Field::kMassHard));
    sent_step.SerializeToString(&bytes);
    read_step.ParseFromString(bytes);
    take(step_read.f64(Field::kVelocityJump), read_step.velocity_jump());
    take(step_read.f64(Field::kPressure), read_step.pressure());
    take(step_read.f64(Field::kStressSoft), read_step.stress_soft());
    take(step_read.f64(Field::kStressHard), read_step.stress_hard());
    take(step_read.f64(Field::kMassSoft), read_step.mass_soft());
    take(step_read.f64(Field::kMassHard), read_step.mass_hard());
    fill(*sent_answer.mutable_shear_stress(), answer.f64(Field::kShearStress));
    fill(*sent_answer.mutable_sliding_velocity(), answer.f64(Field::kSlidingVelocity));
    fill(*sent_answer.mutable_interface_temperature(), answer.f64(Field::kInterfaceTemperature));
    fill(*sent_answer.mutable_velocity_jump_new(), answer.f64(Field::kVelocityJumpNew));
    fill(*sent_answer.mutable_friction_heat(), answer.f64(Field::kFrictionHeat));
    sent_answer.mutable_regime()->assign(nodes, 1);
    sent_answer.mutable_outcome()->assign(nodes, 0);
    sent_answer.SerializeToString(&bytes);
    read_answer.ParseFromString(bytes);
    take(answer_read.f64(Field::kShearStress), read_answer.shear_stress());
    take(answer_read.f64(Field::kSlidingVelocity), read_answer.sliding_velocity());
    take(answer_read.f64(Field::kInterfaceTemperature), read_answer.interface_temperature());
    take(answer_read.f64(Field::kVelocityJumpNew), read_answer.velocity_jump_new());
    take(answer_read.f64(Field::kFrictionHeat), read_answer.friction_heat());
    benchmark::DoNotOptimize(step_read);
    benchmark::DoNotOptimize(answer_read);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

template <class By>
void steps(benchmark::State& state) {
  By by(support::node_ids(static_cast<std::size_t>(state.range(0))));
  for (auto _ : state) by.step();
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

void sizes(benchmark::internal::Benchmark* one) {
  one->Arg(100)->Arg(10'000)->Arg(100'000);
}

BENCHMARK_CAPTURE(tile, kernel_force_driven, Strategy::kForceDriven)->Name("kernel/force_driven/tile");
BENCHMARK_CAPTURE(twin, kernel_force_driven, Strategy::kForceDriven)->Name("kernel/force_driven/twin");
BENCHMARK_CAPTURE(tile, kernel_velocity_driven, Strategy::kVelocityDriven)->Name("kernel/velocity_driven/tile");
BENCHMARK_CAPTURE(twin, kernel_velocity_driven, Strategy::kVelocityDriven)->Name("kernel/velocity_driven/twin");
BENCHMARK(columns)->Name("codec/columns")->Apply(sizes);
BENCHMARK(packed)->Name("codec/packed")->Apply(sizes);
BENCHMARK_TEMPLATE(steps, ByShard)->Name("step/shard")->Apply(sizes);
BENCHMARK_TEMPLATE(steps, ByService)->Name("step/service")->Apply(sizes);

}  // namespace
}  // namespace shearbus::bench
