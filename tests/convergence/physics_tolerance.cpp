// Runs with a tolerance: the error is below the requested tolerance and falls with the tolerance, when slip starts,
// reverses or stops and when the layer melts, for long and short steps of the host. Where the tolerance cannot be met,
// the error estimate reports this. Errors are relative to the melting temperature minus the initial temperature.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ostream>
#include <string>
#include <vector>

#include "server/physics/interface/friction_laws.hpp"
#include "tests/support/fine_layer.hpp"
#include "tests/support/force_loops.hpp"
#include "tests/support/physics_rig.hpp"
#include "tests/support/turning_histories.hpp"

namespace shearbus::testing {
namespace {

constexpr double kEnd = 1e-6;
constexpr double kToMelting = 1220.0 - 300.0;
constexpr double kStepShare = 0.25;  // largest accepted error estimate of a step, as a share of the tolerance

ModelOptions half_space(Strategy strategy = Strategy::kForceDriven) {
  ModelOptions options = paper_options(strategy);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  return options;
}

ModelOptions with_cells(ModelOptions options, int cells, double first) {
  options.grid.cells = cells;
  options.grid.grading = std::pow(1.0 + options.grid.thickness / first, 1.0 / cells);
  options.time_integrator = TimeIntegrator::kSdirk2;
  return options;
}

struct History {
  // T0 [K] after every tenth of the run, or after every step of a run with fewer than ten steps
  std::vector<double> temperature;
  double estimate = 0.0;  // largest error estimate of a step in the run
};

History run(const ModelOptions& options, int steps, double velocity_jump) {
  Rig rig(options, 1);
  rig.set_all(velocity_jump, 11.2e9);
  History history;
  for (int n = 1; n <= steps; ++n) {
    rig.step(kEnd / steps);
    history.estimate = std::max(history.estimate, rig.outputs.error_estimate[0]);
    if (n * std::min(steps, 10) % steps == 0) history.temperature.push_back(rig.T(0));
  }
  return history;
}

class DeliveredVelocityDriven : public ::testing::TestWithParam<double> {};

// The velocity jumps of this test: at 3 m/s the layer hardly warms, at 100 m/s it melts after a third of the run, at
// 1000 m/s at once.
TEST_P(DeliveredVelocityDriven, ErrorIsBelowTheOneRequestedAndFollowsIt) {
  const double velocity_jump = GetParam();
  constexpr int kSubsteps = 4000;
  const ModelOptions fine = with_cells(paper_options(), 400, 0.3e-9);
  test::FineLayer layer(fine, kEnd / kSubsteps);
  TileInputs inputs;
  inputs.active = 1;
  inputs.velocity_jump[0] = velocity_jump;
  inputs.pressure[0] = 11.2e9;
  TileOutputs out{};
  std::vector<double> exact;
  for (int n = 1; n <= kSubsteps; ++n) {
    layer.advance(inputs, 1.0, out);
    if (n * 10 % kSubsteps == 0) exact.push_back(out.interface_temperature[0]);
  }
  for (const int steps : {2, 10, 100}) {
    double last = 1.0;
    for (const double request : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
      if (request < 1e-4 && steps == 2) continue;  // a run with few steps and a small tolerance takes too long
      const History found = run(discretised(paper_options(), request), steps, velocity_jump);
      double delivered = 0.0;
      for (std::size_t i = 0; i < found.temperature.size(); ++i) {
        const double reference = exact[(i + 1) * exact.size() / found.temperature.size() - 1];
        delivered = std::max(delivered, std::abs(found.temperature[i] - reference) / kToMelting);
      }
      std::printf("%5g m/s %4d steps, requested %.0e: delivered %.1e, estimate %.1e\n", velocity_jump, steps, request,
                  delivered, found.estimate);
      EXPECT_LT(delivered, request);
      EXPECT_LE(found.estimate, kStepShare * request);
      EXPECT_LT(delivered, std::max(last, 0.5 * request));
      last = delivered;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, DeliveredVelocityDriven, ::testing::Values(3.0, 100.0, 1000.0),
                         [](const auto& test) { return std::to_string(static_cast<int>(test.param)) + "mPerS"; });

// The error estimate of a step does not include the error of the grid. In 12 us the heat fills an insulated layer, or
// passes into the half-space behind a layer; the test compares grids over this time.
struct Body {
  const char* what;
  ModelOptions options;
};

ModelOptions held(ModelOptions options) {
  options.grid.far_boundary = FarBoundary::kIsothermal;
  if (options.hard_grid) options.hard_grid->far_boundary = FarBoundary::kIsothermal;
  return options;
}

std::vector<Body> bodies() {
  ModelOptions steady = paper_options();
  // With mu = 0.01 the heat flux is constant until melting, the case with the largest grid error of a slab.
  steady.friction_coefficient = 0.01;
  ModelOptions steady_half_space = half_space(Strategy::kVelocityDriven);
  steady_half_space.friction_coefficient = 0.02;
  return {{"insulated", paper_options()},
          {"insulated, constant flux", steady},
          {"half-space", half_space(Strategy::kVelocityDriven)},
          {"half-space, constant flux", steady_half_space},
          {"two-sided", two_sided(half_space(Strategy::kVelocityDriven))},
          {"isothermal", held(paper_options())},
          {"isothermal, constant flux", held(steady)},
          {"isothermal, two-sided", held(two_sided(paper_options()))}};
}

double from_environment(const char* name, double otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::atof(text) : otherwise;
}

// T0, impulse and heat of every history, all of which slip, are within every request, and no request is answered with
// many times the accuracy. SHEARBUS_SEEDS sets the number of seeds, of eight histories each,
// SHEARBUS_LEAST_TOLERANCE the smallest request.
TEST(DeliveredTolerance, HistoriesThatTurnWhileThePressureChangesAreKept) {
  const auto seeds = static_cast<unsigned>(from_environment("SHEARBUS_SEEDS", 4));
  const double least = from_environment("SHEARBUS_LEAST_TOLERANCE", 1e-4);
  std::vector<double> requests = {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
  std::erase_if(requests, [&](double request) { return request < 0.99 * least; });
  for (const TurningAnswers& answers : run_turning_histories(seeds, requests)) {
    const auto [median, worst] = answers.over_request(&TurningErrors::largest);
    std::printf("requested %.0e, %.0f sums a step: median %.3f of it delivered, at most %.2f\n", answers.request,
                answers.sums, median, worst);
    EXPECT_LE(worst, 1.0);
    EXPECT_GE(median, 0.1);
  }
}

struct LoopScene {
  const char* what;
  ModelOptions options;
  double least;  // smallest request, and substeps of a step of the reference
  int substeps;
  int seeds = 6;            // number of histories
  double most_cost = 1e30;  // largest work of a step with a tolerance, over that of an undivided step on the same grid
};
std::ostream& operator<<(std::ostream& out, const LoopScene& scene) {
  return out << scene.what;
}

std::vector<LoopScene> loop_scenes() {
  const ModelOptions rigid = half_space();
  ModelOptions junctions = rigid, flowing = rigid, weakening = rigid, profile = two_sided(rigid);
  junctions.junctions = {0.5, 1e-7, rigid.soft};
  junctions.junctions->metal.yield_strength = rigid.interface.yield_strength;
  flowing.plastic_layer = true;
  flowing.interface.yield_strength = 500e6;
  weakening.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  weakening.interface.friction_coefficient = 0.1;
  weakening.interface.friction_coefficient_fast = 0.02;
  weakening.interface.velocity_decay = 0.01;
  return {{"Rigid", rigid, 1e-4, 1024},
          {"Isothermal", held(paper_options(Strategy::kForceDriven)), 1e-4, 1024},
          {"TwoSided", profile, 1e-4, 256},
          {"Junctions", junctions, 1e-3, 512},
          {"VelocityWeakening", weakening, 1e-3, 512},
          {"PlasticLayer", flowing, 1e-3, 1024, 24, 7.0}};
}

// Requests are kept over random force-driven histories, too, as far down as each scene says: T0 and heat. SHEARBUS_SEEDS sets
// the number of histories, SHEARBUS_FIRST_SEED the first, SHEARBUS_LEAST_TOLERANCE the smallest request and
// SHEARBUS_REFERENCE_GRID the request of whose tolerance the reference has the grid, relative to the smallest.
class ForceLoops : public ::testing::TestWithParam<LoopScene> {};
INSTANTIATE_TEST_SUITE_P(, ForceLoops, ::testing::ValuesIn(loop_scenes()),
                         [](const auto& scene) { return std::string(scene.param.what); });
TEST_P(ForceLoops, AreKept) {
  const LoopSeeds seeds{static_cast<unsigned>(from_environment("SHEARBUS_FIRST_SEED", 1)),
                        static_cast<unsigned>(from_environment("SHEARBUS_SEEDS", GetParam().seeds))};
  const double finer = from_environment("SHEARBUS_REFERENCE_GRID", 0.1);
  const double least = std::max(GetParam().least, from_environment("SHEARBUS_LEAST_TOLERANCE", 1e-4));
  std::vector<double> requests = {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
  std::erase_if(requests, [&](double request) { return request < 0.99 * least; });
  for (const LoopAnswers& answers : run_force_loops(GetParam().options, seeds, requests, GetParam().substeps, finer)) {
    const auto [median, worst] = answers.over_request();
    double T0 = 0.0, impulse = 0.0, jump = 0.0, heat = 0.0;
    std::string missed;  // seeds
    for (const LoopErrors& one : answers.errors) {
      T0 = std::max(T0, one.T0 / answers.request);
      impulse = std::max(impulse, one.impulse / answers.request);
      jump = std::max(jump, one.jump / answers.request);
      heat = std::max(heat, one.heat / answers.request);
      if (one.largest() > answers.request)
        (missed += ' ') += std::to_string(seeds.first + (&one - answers.errors.data()));
    }
    const double cost = answers.work / answers.undivided;
    std::printf(
        "requested %.0e, work %.0f a step, %.1f times an undivided one: median %.3f, at most %.2f (T0 %.2f, impulse "
        "%.2f, heat %.2f; jump %.2f)\n",
        answers.request, answers.work, cost, median, worst, T0, impulse, heat, jump);
    EXPECT_LE(worst, 1.0) << "seeds" << missed;
    EXPECT_LE(cost, GetParam().most_cost);
  }
}

// A node at rest sleeps under a tolerance, too, and answers as one that is solved, within the tolerance of both.
TEST(DeliveredTolerance, HoldsWhereNodesSleep) {
  constexpr double kRequest = 1e-3;
  ModelOptions options = half_space(Strategy::kVelocityDriven);
  ModelOptions sleepy = options;
  sleepy.sleep = true;
  Rig awake(discretised(options, kRequest), 1), rig(discretised(sleepy, kRequest), 1);
  int asleep = 0, woken = 0;
  for (int n = 0; n < 300; ++n) {
    const bool slips = n % 150 < 10;
    for (Rig* each : {&awake, &rig}) {
      each->set_all(slips ? 80.0 : 0.0, n % 150 < 80 ? 8e9 : -1.0);
      each->step(1e-8);
    }
    asleep += (rig.outputs.outcome[0] & kAsleep) != 0;
    woken += slips && n > 10 && (rig.outputs.outcome[0] & kAsleep) == 0;
    EXPECT_NEAR(rig.outputs.interface_temperature[0], awake.outputs.interface_temperature[0],
                2.0 * kRequest * kToMelting)
        << n;
    EXPECT_LE(rig.outputs.error_estimate[0], kStepShare * kRequest);
  }
  EXPECT_GT(asleep, 100);
  EXPECT_EQ(woken, 10);
}

// A jump that is slip and turns starts at the yield stress: the stress before, which the pressure can no longer hold, is no
// part of the step.
TEST(DeliveredTolerance, SlipMayTurnInTheStepInWhichThePressureFalls) {
  constexpr double kRequest = 1e-4;
  ModelOptions options = paper_options();
  options.drive = Drive::kInterfaceSlip;
  ModelOptions fixed = discretised(options, kRequest);
  Rig rig(fixed, 1);
  fixed.tolerance.reset();
  Rig fine(fixed, 1);
  for (int n = 0; n < 10; ++n) {
    for (Rig* each : {&rig, &fine}) each->set_all(n < 5 ? 100.0 : -40.0, n < 5 ? 15e9 : 9e9);
    rig.step(20e-9);
    for (int i = 0; i < 100; ++i) fine.step(0.2e-9);
    EXPECT_NEAR(rig.T(0), fine.T(0), kRequest * kToMelting) << n;
    EXPECT_NEAR(rig.stress() / fine.stress(), 1.0, 1e-3) << n;
  }
}

TEST(DeliveredTolerance, TheGridIsFineEnoughWhereverHeatGoes) {
  const auto run_long = [](const ModelOptions& options, int steps) {
    Rig rig(options, 1);
    rig.set_all(10.0, 11.2e9);
    std::vector<double> T;
    for (int n = 1; n <= steps; ++n) {
      rig.step(12e-6 / steps);
      if (n * 20 % steps == 0) T.push_back(rig.T(0));
    }
    return T;
  };
  for (const Body& body : bodies()) {
    ModelOptions fine = with_cells(body.options, 400, 0.3e-9);
    if (fine.hard_grid) {
      fine.hard_grid->cells = fine.grid.cells;
      fine.hard_grid->grading = fine.grid.grading;
    }
    const std::vector<double> exact = run_long(fine, 1000);
    for (const double request : {1e-2, 1e-3, 1e-4}) {
      const std::vector<double> found = run_long(discretised(body.options, request), 40);
      double delivered = 0.0;
      for (std::size_t i = 0; i < found.size(); ++i)
        delivered = std::max(delivered, std::abs(found[i] - exact[i]) / kToMelting);
      std::printf("%s, to %.0f K, requested %.0e: delivered %.1e\n", body.what, exact.back(), request, delivered);
      EXPECT_LT(delivered, request) << body.what;
    }
  }
}

// Two plates under constant far stresses, in a single step of the host.
struct Plates {
  const char* what;
  double velocity_jump;  // velocity jump before the step [m/s]
  double pull;           // shear stress far from the interface, the same on both bodies [Pa]
  double dt;             // length of the host's step [s]
};

class DeliveredInOneStep : public ::testing::TestWithParam<Plates> {};

// If the slip reverses in the first half of a step, the step and its two halves agree although both are wrong. The
// error estimate must detect the reversal itself, so that the tolerance is kept.
TEST_P(DeliveredInOneStep, TemperatureAndJumpAreKept) {
  const Plates& plates = GetParam();
  const auto load = [&](TileInputs& inputs) {
    inputs.velocity_jump[0] = plates.velocity_jump;
    inputs.pressure[0] = 11.2e9;
    inputs.stress_soft[0] = inputs.stress_hard[0] = plates.pull;
    inputs.mass_soft[0] = inputs.mass_hard[0] = 1.0;
    inputs.active = 1;
  };
  constexpr int kSubsteps = 20000;
  ModelOptions fine = discretised(half_space(), 1e-6);
  fine.tolerance.reset();
  fine.modes->accuracy = 1e-8;
  test::FineLayer layer(fine, plates.dt / kSubsteps);
  TileInputs inputs;
  load(inputs);
  TileOutputs exact{};
  for (int n = 0; n < kSubsteps; ++n) layer.advance(inputs, 1.0 / kSubsteps, exact);
  for (const double request : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
    Rig rig(discretised(half_space(), request), 1);
    load(rig.inputs);
    rig.step(plates.dt);
    const double T0 = std::abs(rig.T(0) - exact.interface_temperature[0]) / kToMelting;
    // `response` is the temperature rise at z = 0 per unit heat flux, 2 sqrt(alpha t / pi) / k, after the time t = dt,
    // but at least kEnd (k = 117 W/m/K, alpha = 48.9e-6 m2/s). An error of the jump causes an error of T0, which is the
    // error of the jump times beta_T = 0.6772, |s| and `response`.
    const double response = 2.0 / 117.0 * std::sqrt(48.9e-6 * std::max(kEnd, plates.dt) / std::acos(-1.0));
    const double jump = 0.6772 * response * std::abs(exact.shear_stress[0]) *
                        std::abs(rig.outputs.velocity_jump_new[0] - exact.velocity_jump_new[0]) / kToMelting;
    std::printf("%s, requested %.0e: T0 %.1e, jump %.1e, estimate %.1e\n", plates.what, request, T0, jump,
                rig.outputs.error_estimate[0]);
    EXPECT_LT(T0, request);
    EXPECT_LT(jump, request);
    EXPECT_LE(rig.outputs.error_estimate[0], kStepShare * request);
  }
}

INSTANTIATE_TEST_SUITE_P(, DeliveredInOneStep,
                         ::testing::Values(Plates{"Starts", 0.0, 300e6, 100e-9}, Plates{"Stops", 40.0, 0.0, 400e-9},
                                           Plates{"TurnsEarly", 7.0, -500e6, 100e-9},
                                           Plates{"TurnsLate", 111.0, -500e6, 100e-9},
                                           Plates{"TurnsInAShortStep", 0.3, -500e6, 1e-9}),
                         [](const auto& test) { return test.param.what; });

// With modes and a second-order step a loose tolerance needs few substeps. The tolerance must be kept nevertheless,
// also in the first step, whose error is the largest because friction starts suddenly.
TEST(DeliveredTolerance, FrictionThatStartsSuddenlyIsResolvedInItsFirstStep) {
  const ModelOptions options = half_space();
  const auto first_step = [](const ModelOptions& of, int steps) {
    Rig rig(of, 1);
    rig.set_all(100.0, 11.2e9);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 0.1;
    for (int n = 0; n < steps; ++n) {
      rig.step(100e-9 / steps);
      rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
    }
    return rig.T(0);
  };
  ModelOptions fine = discretised(options, 1e-6);
  fine.tolerance.reset();
  const double exact = first_step(fine, 20000);
  for (const double request : {1e-3, 1e-4, 1e-5, 1e-6}) {
    const double delivered = std::abs(first_step(discretised(options, request), 1) - exact) / kToMelting;
    std::printf("first step, requested %.0e: delivered %.1e\n", request, delivered);
    EXPECT_LT(delivered, request);
  }
}

// This step needs shorter substeps than the modes can represent. The division then ends at the shortest possible
// substep, and the error estimate must exceed the limit that the tolerance sets.
TEST(DeliveredTolerance, TheEstimateSaysWhereItIsNotKept) {
  Rig rig(discretised(half_space(), 1e-6), 1);
  rig.inputs.pressure[0] = 11.2e9;
  rig.inputs.velocity_jump[0] = 2e3;
  rig.inputs.stress_soft[0] = rig.inputs.stress_hard[0] = -3e12;
  rig.step(1e-9);
  std::printf("turns within 1e-15 s: estimate %.1e\n", rig.outputs.error_estimate[0]);
  EXPECT_GT(rig.outputs.error_estimate[0], kStepShare * 1e-6);
}

// The cost of a step is counted in evaluations of the stress limit. If little happens in a step, error control solves
// only the step and its two halves. If the slip reverses, it solves only the halvings that lead to the reversal.
TEST(DeliveredTolerance, EffortGoesWhereTheErrorIs) {
  const auto effort_of = [](const ModelOptions& options, double pull) {
    Rig rig(options, 1);
    SearchEffort effort;
    rig.inputs.effort = &effort;
    rig.set_all(50.0, 11.2e9);
    rig.inputs.stress_soft[0] = rig.inputs.stress_hard[0] = pull;
    rig.step(1e-9);
    rig.inputs.velocity_jump[0] = 0.5;
    effort = {};
    rig.step(1e-9);
    return effort.limit_values;
  };
  ModelOptions plain = discretised(half_space(), 1e-3);
  plain.tolerance.reset();
  EXPECT_LE(effort_of(discretised(half_space(), 1e-3), 0.0), 4 * effort_of(plain, 0.0));
  const int turning = effort_of(discretised(half_space(), 1e-3), -500e6);
  std::printf("values of the limit: %d plain, %d controlled, %d where the slip turns\n", effort_of(plain, 0.0),
              effort_of(discretised(half_space(), 1e-3), 0.0), turning);
  EXPECT_LE(turning, 60 * effort_of(plain, 0.0));
}

}  // namespace
}  // namespace shearbus::testing
