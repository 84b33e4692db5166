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

void BM_LayerShear(benchmark::State& state) {
  run(state, grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0))));
}
void BM_InterfaceSlip(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.drive = Drive::kInterfaceSlip;
  run(state, options);
}
void BM_ForceDriven(benchmark::State& state) {
  run(state, grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0))));
}

// Cost of a step with a plastic layer. With flows:0 the interface has the yield strength of the unhardened layer,
// 200 MPa; with flows:1 it has 400 MPa, so that the layer flows.
void BM_PlasticLayer(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0)));
  options.plastic_layer = true;
  if (state.range(1) != 0) options.interface.yield_strength = 400e6;
  run(state, options);
}

void BM_Junctions(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0)));
  options.junctions = {0.5, 1e-7, options.soft};
  run(state, options);
}

void BM_TwoSided(benchmark::State& state) {
  run(state, two_sided(grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)))));
}
void BM_PlasticHeating(benchmark::State& state) {
  ModelOptions options = two_sided(grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0))));
  options.taylor_quinney_factor = 1.0;
  run(state, options);
}
void BM_JohnsonCook(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.soft = make_material("copper_ofhc_jc", {}).material;
  run(state, options);
}
void BM_PrestonTonksWallace(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.soft = make_material("copper_ofhc_ptw", {}).material;
  run(state, options);
}
void BM_VelocityWeakening(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, static_cast<int>(state.range(0)));
  options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  options.interface.friction_coefficient_fast = 0.02;
  options.interface.velocity_decay = 0.01;
  run(state, options);
}
void BM_UnderPressure(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.soft.melting_curve = MeltingCurve::kLindemann;
  options.soft.pressure_term = PressureTerm::kCompressed;
  run(state, options);
}

void BM_Sdirk2(benchmark::State& state) {
  const bool forced = state.range(1) != 0;
  ModelOptions options =
      grid_options(forced ? Strategy::kForceDriven : Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.time_integrator = TimeIntegrator::kSdirk2;
  run(state, options);
}

// Cost of a step with decay modes of the heat in place of a temperature profile, for times from 1 ns to 1 us. The modes
// approximate the heat kernel with a relative error of 1e-3 (digits:3) or 1e-6 (digits:6).
void BM_Modes(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kForceDriven, 2);
  options.modes = {.accuracy = state.range(0) == 3 ? 1e-3 : 1e-6, .shortest_step = 1e-9, .longest_time = 1e-6};
  if (state.range(1) != 0) options.time_integrator = TimeIntegrator::kSdirk2;
  run(state, options);
}

void BM_Inertia(benchmark::State& state) {
  ModelOptions options = grid_options(Strategy::kVelocityDriven, static_cast<int>(state.range(0)));
  options.inertia = true;
  run(state, options);
}

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
BENCHMARK(BM_JohnsonCook)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_PrestonTonksWallace)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_VelocityWeakening)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Junctions)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Inertia)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_TwoSided)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_PlasticHeating)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_UnderPressure)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Sdirk2)->ArgNames({"grid", "forced"})->ArgsProduct({{0, 1, 2}, {0, 1}})->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Modes)->ArgNames({"digits", "sdirk2"})->ArgsProduct({{3, 6}, {0, 1}})->Unit(benchmark::kMillisecond);
BENCHMARK(BM_LayerShear)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_InterfaceSlip)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ForceDriven)->ArgName("grid")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_PlasticLayer)
    ->ArgNames({"grid", "flows"})
    ->ArgsProduct({{0, 1, 2}, {0, 1}})
    ->Unit(benchmark::kMillisecond);

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
