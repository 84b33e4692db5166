// Steps of two stages of layers with inertia, in random scenes, states and inputs: each stage is a step of backward
// Euler whose equations hold to rounding, and the energy of the whole step balances.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "server/physics/solver/sdirk2.hpp"
#include "tests/support/random_physics.hpp"
#include "tests/support/wave_stage.hpp"

namespace shearbus::testing {
namespace {

using sdirk2::kDiagonal;
using sdirk2::kExtrapolation;
using sdirk2::kFirstWeight;

// The fields from which the second stage starts: extrapolated through the first one, temperatures then conducted.
WaveFields second_start(const Rig& rig, int lane, const WaveStage& first) {
  const HeatOperator& stage = rig.operators->stage();
  const HeatGrid& grid = rig.heat_grid();
  const double* T_old = rig.committed.data() + rig.model.layout().first_temperature();
  std::vector<double> T(static_cast<std::size_t>(grid.num_vertices() * kLanes));
  conduct(stage, grid.num_vertices(), T_old, T.data());
  add_flux_lane(stage, grid.num_vertices(), lane, first.answer().flux, T.data());
  const double unused[kLanes] = {};
  sdirk2::begin_second_stage(stage, grid.num_vertices(), T_old, unused, T.data());
  WaveFields start = first.before();
  for (int i = 0; i <= first.cells(); ++i) {
    start.T_ad[i] = T[(std::size_t(grid.interface) + std::size_t(i)) * kLanes + std::size_t(lane)];
    const auto extrapolate = [](double before, double& value, double after) {
      value = before + kExtrapolation * (after - before);
    };
    const double strain = first.before().strain[i];
    extrapolate(strain, start.strain[i], strain + first.fields().strain_growth[i]);
    extrapolate(first.before().stress[i], start.stress[i], first.fields().stress[i]);
    if (i == first.cells()) continue;
    extrapolate(first.before().velocity[i], start.velocity[i], first.fields().velocity[i]);
  }
  return start;
}

// The energy balance of a step of two stages: work of the soft body = growth of kinetic and elastic energy + plastic
// work + work of the slip at z = 0 + what the scheme loses, where |..|^2 is twice the energy of a difference of states:
//   loss = (|second stage - its start|^2 - |first stage - its start|^2) / 2
struct Energy {
  double loss = 0.0;
  double fault = 0.0;  // residual of the balance, relative to the sum of its terms
};
Energy energy_of(const WaveStage& first, const WaveStage& second) {
  const int n = first.cells();
  const double dt = first.step().dt / kDiagonal;
  const WaveFields &old = first.before(), &u1 = first.fields(), &start = second.before(), &u2 = second.fields();
  double balance = 0.0, size = 0.0;
  Energy energy;
  const auto add = [&](double term) {
    balance += term;
    size += std::abs(term);
  };
  add(-dt * (kFirstWeight * u1.stress[n] + kDiagonal * u2.stress[n]) * first.step().jump);
  add(dt * (kFirstWeight * u1.stress[0] * first.velocity(-1) + kDiagonal * u2.stress[0] * second.velocity(-1)));
  const auto of_state = [&](double twice, double before, double stage, double from, double end) {
    add(0.5 * twice * (end - before) * (end + before));
    const double second_loss = 0.5 * twice * (end - from) * (end - from);
    const double first_loss = 0.5 * twice * (stage - before) * (stage - before);
    energy.loss += second_loss - first_loss;
    add(second_loss);
    add(-first_loss);
    size += twice * (before * before + from * from + end * end);
  };
  for (int c = 0; c < n; ++c) {
    of_state(first.mass(c), old.velocity[c], u1.velocity[c], start.velocity[c], u2.velocity[c]);
    size += (first.momentum_size(c) + second.momentum_size(c)) * (first.largest_velocity() + kLeastVelocity);
  }
  for (int i = 0; i <= n; ++i) {
    const double weight = first.step().grid->weight[static_cast<std::size_t>(i)];
    of_state(weight / first.soft().shear_modulus, old.stress[i], u1.stress[i], start.stress[i], u2.stress[i]);
    add(kSqrt3 * weight * kExtrapolation * std::abs(u1.stress[i]) * u1.strain_growth[i]);
    add(kSqrt3 * weight * std::abs(u2.stress[i]) * u2.strain_growth[i]);
    size += 1e9 * kSqrt3 * weight * (std::abs(u1.stress[i]) + std::abs(u2.stress[i])) * second.ulp_of_strain(i);
  }
  energy.fault = std::abs(balance) / size;
  return energy;
}

class PhysicsWavesStages : public ::testing::TestWithParam<bool> {};

TEST_P(PhysicsWavesStages, EveryEquationHoldsForRandomScenesAndInputs) {
  const bool extreme = GetParam();
  Draw draw(61 + (extreme ? 1 : 0));
  double momentum = 0.0, kinematic = 0.0, balance = 0.0;
  int steps = 0, of_first = 0, flowing = 0, slipping = 0, melting = 0, gains = 0;
  for (int scene = 0; scene < 60; ++scene) {
    Rig rig(of_second_order(random_inertia_options(draw, extreme)));
    for (int n = 0; n < 25; ++n) {
      random_inputs(draw, rig, extreme);
      const double dt = random_dt(draw, extreme);
      rig.operators = rig.model.operators(dt);
      rig.inputs.wants_mean_stress = true;
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        if (rig.inputs.pressure[l] <= 0.0 || (rig.outputs.outcome[l] & kFailed)) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        ++steps;
        if (rig.outputs.outcome[l] & kFirstOrder) {
          ++of_first;
          continue;
        }
        std::swap(rig.committed, rig.trial);  // the state before the step
        WaveStage one(rig, l, rig.operators->stage());
        one.solve();
        WaveStage two(rig, l, rig.operators->stage(), second_start(rig, l, one));
        two.solve();
        std::swap(rig.committed, rig.trial);
        for (int i = 0; i <= one.cells(); ++i)
          ASSERT_NEAR(stress_at(rig, i, l), two.fields().stress[i], 1e-7 * two.stress_size(i)) << i;
        for (const WaveStage* stage : {&one, &two}) {
          momentum = std::max(momentum, stage->momentum_fault());
          kinematic = std::max(kinematic, stage->kinematic_fault());
          ASSERT_LE(stage->momentum_fault(), extreme ? 1e-6 : 1e-8);
          ASSERT_LE(stage->kinematic_fault(), 1e-12);
          stage->expect_flow_law();
          if (::testing::Test::HasFatalFailure()) return;
        }
        // The stresses of the bodies' work are those of the energy balance.
        const auto mean = [&](int i) {
          return kFirstWeight * one.fields().stress[i] + kDiagonal * two.fields().stress[i];
        };
        ASSERT_NEAR(rig.outputs.mean_shear_stress[l], mean(0), 1e-7 * two.stress_size(0));
        ASSERT_NEAR(rig.outputs.mean_far_stress[l], mean(one.cells()), 1e-7 * two.stress_size(one.cells()));
        const Energy energy = energy_of(one, two);
        balance = std::max(balance, energy.fault);
        ASSERT_LE(energy.fault, 1e-9);
        gains += energy.loss < 0.0;
        ASSERT_GE(rig.outputs.shear_stress[l] * rig.outputs.sliding_velocity[l], 0.0);
        const double flux = kFirstWeight * one.answer().flux + kDiagonal * two.answer().flux;
        ASSERT_NEAR(rig.outputs.friction_heat[l], flux * dt, 1e-7 * two.heat_size() / kDiagonal);
        flowing += rig.outputs.regime[l] == Regime::kTresca;
        slipping += rig.outputs.regime[l] == Regime::kCoulomb;
        melting += rig.outputs.regime[l] == Regime::kMelting;
      }
    }
  }
  std::printf(
      "%d node-steps, %d of first order: tresca %d, coulomb %d, melting %d; worst momentum %.1e, kinematics %.1e, "
      "energy %.1e; the scheme gains energy in %d\n",
      steps, of_first, flowing, slipping, melting, momentum, kinematic, balance, gains);
  EXPECT_GT(std::min({flowing, slipping, melting}), extreme ? 10 : 200);
  EXPECT_LT(of_first, steps / (extreme ? 2 : 10));
}

INSTANTIATE_TEST_SUITE_P(, PhysicsWavesStages, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "Extreme" : "Usual"; });

// An elastic layer between resting bodies: SDIRK2's amplification of a free vibration is below 1 for any step length
// (L-stable), so that a step of any vibration loses energy. Steps in cells and vertices as in a random state.
TEST(PhysicsWavesEnergy, AFreeVibrationNeverGainsEnergy) {
  ModelOptions options = of_second_order(with_inertia(graded(paper_options())));
  options.soft.yield_strength = 1e15;
  Draw draw(67);
  for (double dt : {1e-12, 1e-10, 1e-9, 1e-7}) {
    Rig rig(options, 1);
    rig.set_all(0.0, 1e9);
    rig.step(1e-15);
    const TileLayout& layout = rig.model.layout();
    for (std::size_t i = 0; i < layout.num_stress_vertices; ++i)
      rig.committed[layout.shear_stress + i * kLanes] = draw.uniform(-1e8, 1e8);
    for (std::size_t i = 0; i < layout.num_velocity_cells; ++i)
      rig.committed[layout.layer_velocity + i * kLanes] = draw.uniform(-10.0, 10.0);
    const auto energy = [&] {
      double sum = 0.0;
      const Grid& grid = rig.model.grid();
      for (int i = 0; i < grid.num_vertices(); ++i)
        sum += 0.5 * grid.weight[i] / options.soft.shear_modulus * stress_at(rig, i) * stress_at(rig, i);
      for (int c = 0; c < grid.num_cells(); ++c)
        sum += 0.5 * grid.width[c] * options.soft.density * velocity_in(rig, c) * velocity_in(rig, c);
      return sum;
    };
    const double start = energy();
    double before = start;
    for (int n = 0; n < 200; ++n) {
      rig.step(dt);
      ASSERT_EQ(rig.outputs.regime[0], Regime::kStick);
      const double now = energy();
      ASSERT_LE(now, before * (1 + 1e-14)) << dt << " s, step " << n;
      before = now;
    }
    std::printf("200 steps of %.0e s of a free vibration keep %.3e of its energy\n", dt, before / start);
  }
}

}  // namespace
}  // namespace shearbus::testing
