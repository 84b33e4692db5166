// Cost of the layer solvers under the paper's conditions (100 m/s, 11.2 GPa, dt 1 ns), averaged over the first 1 us.
// The counter per_node_step is the CPU time of a tile's step divided by the number of lanes of the tile. grid:0 has the
// paper's 500 uniform cells, grid:1 has 60 cells graded 1.08, grid:2 has the cells of grid:1 and a half-space behind
// them. BM_Conduct measures only the heat conduction of one step, per node, in a layer that has been heated for `steps`
// steps. BM_Operators measures the time to prepare a new step length; there grid:3 means decay modes and no grid.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr int kStepsPerRun = 1000;

ModelOptions grid_options(Strategy strategy, int grid) {
  ModelOptions options = paper_options(strategy);
  if (grid > 0) options = graded(options);
  if (grid > 1) options.grid.far_boundary = FarBoundary::kHalfSpace;
  return options;
}

template <class Step>
void run(benchmark::State& state, const ModelOptions& options, const Step& step) {
  Rig rig(options);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703 * 2.5e-6;
    rig.inputs.mass_hard[l] = 7900 * 2.5e-6;
    rig.inputs.pressure[l] = 11.2e9;
  }
  const std::vector<double> start = rig.committed;
  for (auto _ : state) {
    rig.committed = start;
    for (int n = 0; n < kStepsPerRun; ++n) {
      // The inputs differ slightly between lanes, as they do between the nodes of one interface.
      for (int l = 0; l < kLanes; ++l) rig.inputs.velocity_jump[l] = 100.0 + l;
      step(rig, n);
    }
    benchmark::DoNotOptimize(rig.outputs);
  }
  state.counters["per_node_step"] = benchmark::Counter(
      kStepsPerRun * kLanes, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void run(benchmark::State& state, const ModelOptions& options) {
  run(state, options, [](Rig& rig, int) { rig.step(1e-9); });
}

// Benchmarks of layers on each grid: the paper's, with some of its options changed. The interface of BM_PlasticLayer has
// the yield strength of the unhardened layer, 200 MPa; that of BM_FlowingLayer has 400 MPa, so that the layer flows.
struct Layer {
  const char* name;
  Strategy strategy;
  void (*change)(ModelOptions&);
};
constexpr Strategy kVelocity = Strategy::kVelocityDriven, kForce = Strategy::kForceDriven;
const Layer kLayers[] = {
    {"BM_LayerShear", kVelocity, [](auto&) {}},
    {"BM_InterfaceSlip", kVelocity, [](auto& o) { o.drive = Drive::kInterfaceSlip; }},
    {"BM_ForceDriven", kForce, [](auto&) {}},
    {"BM_PlasticLayer", kForce, [](auto& o) { o.plastic_layer = true; }},
    {"BM_FlowingLayer", kForce, [](auto& o) { o.plastic_layer = true, o.interface.yield_strength = 400e6; }},
    {"BM_Junctions", kForce,
     [](auto& o) {
       o.junctions = JunctionOptions{0.5, 1e-7, o.soft};
     }},
    {"BM_TwoSided", kVelocity, [](auto& o) { o = two_sided(o); }},
    {"BM_PlasticHeating", kVelocity, [](auto& o) { o = two_sided(o), o.taylor_quinney_factor = 1.0; }},
    {"BM_JohnsonCook", kVelocity, [](auto& o) { o.soft = make_material("copper_ofhc_jc", {}).material; }},
    {"BM_PrestonTonksWallace", kVelocity, [](auto& o) { o.soft = make_material("copper_ofhc_ptw", {}).material; }},
    {"BM_VelocityWeakening", kForce,
     [](auto& o) {
       o.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
       o.interface.friction_coefficient_fast = 0.02;
       o.interface.velocity_decay = 0.01;
     }},
    {"BM_UnderPressure", kVelocity,
     [](auto& o) {
       o.soft.melting_curve = MeltingCurve::kLindemann;
       o.soft.pressure_term = PressureTerm::kCompressed;
     }},
    {"BM_Inertia", kVelocity, [](auto& o) { o.inertia = true; }},
    {"BM_Sdirk2", kVelocity, [](auto& o) { o.time_integrator = TimeIntegrator::kSdirk2; }},
    {"BM_Sdirk2ForceDriven", kForce, [](auto& o) { o.time_integrator = TimeIntegrator::kSdirk2; }},
};
void run_on_grid(benchmark::State& state, const Layer& layer) {
  ModelOptions options = grid_options(layer.strategy, static_cast<int>(state.range(0)));
  layer.change(options);
  run(state, options);
}
[[maybe_unused]] const bool kRegistered = [] {
  for (const Layer& layer : kLayers)
    benchmark::RegisterBenchmark(layer.name, run_on_grid, layer)
        ->ArgName("grid")
        ->DenseRange(0, 2)
        ->Unit(benchmark::kMillisecond);
  return true;
}();

// Cost of a step with decay modes of the heat in place of a temperature profile, for times from 1 ns to 1 us. The modes
// approximate the heat kernel with a relative error of 1e-3 (digits:3) or 1e-6 (digits:6).
void BM_Modes(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, 2);
  options.modes = {.accuracy = state.range(0) == 3 ? 1e-3 : 1e-6, .shortest_step = 1e-9, .longest_time = 1e-6};
  if (state.range(1) != 0) options.time_integrator = TimeIntegrator::kSdirk2;
  run(state, options);
}
BENCHMARK(BM_Modes)->ArgNames({"digits", "sdirk2"})->ArgsProduct({{3, 6}, {0, 1}})->Unit(benchmark::kMillisecond);

// Cost of a step with two tangential components. The second component of the jump starts at a third of the first and
// falls to about half of its initial value, so that the direction of the slip turns. forced:1 is force-driven, forced:0
// velocity-driven.
void BM_TwoComponents(benchmark::State& state) {
  const bool forced = state.range(1) != 0;
  ModelOptions options =
      grid_options(forced ? Strategy::kForceDriven : Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.tangential_components = 2;
  run(state, options, [&](Rig& rig, int n) {
    for (int l = 0; l < kLanes; ++l) rig.inputs.second_velocity_jump[l] = 33.0 * std::cos(1e-3 * n);
    rig.step(1e-9);
  });
}
BENCHMARK(BM_TwoComponents)
    ->ArgNames({"grid", "forced"})
    ->ArgsProduct({{0, 1, 2}, {0, 1}})
    ->Unit(benchmark::kMillisecond);

// A tile whose nodes have slid and now stick under a constant far stress: solved, or asleep. forced:1 is a force-driven
// plastic layer, forced:0 velocity-driven.
void BM_StuckTile(benchmark::State& state) {
  const bool forced = state.range(0) != 0;
  ModelOptions options = paper_options(forced ? kForce : kVelocity);
  options.grid = {100e-6, 80, 1.06, FarBoundary::kHalfSpace};
  options.plastic_layer = forced;
  options.sleep = state.range(1) != 0;
  Rig rig(options);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = 1.0;
    rig.inputs.stress_soft[l] = rig.inputs.stress_hard[l] = 20e6;
  }
  const auto steps = [&](int count, double jump, double pressure) {
    rig.set_all(jump, pressure);
    for (int n = 0; n < count; ++n) rig.step(2e-9);
  };
  steps(100, 60.0, 5e9);
  steps(1, 1.0, -1.0);  // the contact opens, which sets its stress to 0
  steps(20, 1.0, 5e9);
  steps(80, 0.0, 5e9);
  for (auto _ : state) steps(1, 0.0, 5e9);
  state.counters["asleep"] = (rig.outputs.outcome[0] & kAsleep) != 0 ? 1.0 : 0.0;
  state.counters["per_node_step"] =
      benchmark::Counter(kLanes, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_StuckTile)->ArgNames({"forced", "sleep"})->ArgsProduct({{0, 1}, {0, 1}})->Unit(benchmark::kMicrosecond);

// Cost of the energy ledger of a step, which the server computes only on request.
void BM_Ledger(benchmark::State& state) {
  Rig rig(grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0))));
  rig.set_all(100.0, 11.2e9);
  rig.step(1e-9);
  TileLedger ledger;
  for (auto _ : state) {
    rig.model.record_energy(*rig.operators, rig.inputs, rig.outputs, rig.trial.data(), rig.committed.data(), ledger);
    benchmark::DoNotOptimize(ledger);
  }
  state.counters["per_node_step"] =
      benchmark::Counter(kLanes, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Ledger)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMicrosecond);

void BM_Conduct(benchmark::State& state) {
  Rig rig(grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0))));
  const HeatGrid& grid = rig.heat_grid();
  const HeatOperator heat(grid, rig.model.options().soft, 1e-9);
  std::vector<double> T(rig.committed.begin(), rig.committed.begin() + std::ptrdiff_t{grid.num_vertices()} * kLanes),
      after = T;
  double flux[kLanes];
  for (int l = 0; l < kLanes; ++l) flux[l] = 1e10 * (1.0 + 0.01 * l);
  for (int n = 0; n < state.range(1); ++n) {
    conduct(heat, grid.num_vertices(), T.data(), T.data());
    add_flux(heat, grid.num_vertices(), flux, T.data());
  }
  for (auto _ : state) {
    conduct(heat, grid.num_vertices(), T.data(), after.data());
    benchmark::DoNotOptimize(after.data());
    benchmark::ClobberMemory();
  }
  state.counters["per_node_step"] =
      benchmark::Counter(kLanes, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Conduct)->ArgNames({"grid", "steps"})->ArgsProduct({{0, 1, 2}, {0, 1, 10, 100, 1000}});

// A step of many nodes against a copy of their states, committed to trial, in turn, with the states where the server has
// them: both buffers of a tile next to each other. Processor time, least of all rounds: the counters step_ns and copy_ns
// are per node, and steps_per_copy is their ratio.
void BM_StatesBeyondTheCache(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, 1);
  if (state.range(1) != 0) options.time_integrator = TimeIntegrator::kSdirk2;
  Rig rig(options);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703 * 2.5e-6;
    rig.inputs.mass_hard[l] = 7900 * 2.5e-6;
    rig.inputs.pressure[l] = 11.2e9;
    rig.inputs.velocity_jump[l] = 100.0 + l;
  }
  for (int n = 0; n < 200; ++n) rig.step(1e-9);
  const std::size_t doubles = rig.committed.size(), tiles = static_cast<std::size_t>(state.range(0)) / kLanes;
  std::vector<double> states;
  for (std::size_t i = 0; i < 2 * tiles; ++i) states.insert(states.end(), rig.committed.begin(), rig.committed.end());
  const auto processor_ns = [] { return 1e9 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; };
  double step_ns = 1e30, copy_ns = 1e30;
  const auto least_of = [&](double& least, const auto& pass_of_tile) {
    const double begin = processor_ns();
    for (double* tile = states.data(); tile != states.data() + states.size(); tile += 2 * doubles) pass_of_tile(tile);
    benchmark::ClobberMemory();
    least = std::min(least, (processor_ns() - begin) / static_cast<double>(tiles * kLanes));
  };
  for (auto _ : state) {
    least_of(copy_ns, [&](double* tile) { std::memcpy(tile + doubles, tile, doubles * sizeof(double)); });
    least_of(step_ns,
             [&](double* tile) { rig.model.advance(*rig.operators, rig.inputs, tile, tile + doubles, rig.outputs); });
  }
  state.counters["step_ns"] = step_ns;
  state.counters["copy_ns"] = copy_ns;
  state.counters["steps_per_copy"] = step_ns / copy_ns;
}
BENCHMARK(BM_StatesBeyondTheCache)
    ->ArgNames({"nodes", "sdirk2"})
    ->ArgsProduct({{10000, 100000}, {0, 1}})
    ->Unit(benchmark::kMillisecond);

void BM_Operators(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0)));
  if (state.range(0) == 3) options.modes = {.accuracy = 1e-6, .shortest_step = 1e-9, .longest_time = 1e-6};
  const Model model(options);
  for (auto _ : state) benchmark::DoNotOptimize(model.operators(1e-9));
}
BENCHMARK(BM_Operators)->ArgName("grid")->DenseRange(0, 3)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace shearbus::testing
