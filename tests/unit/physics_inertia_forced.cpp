// Steps of a layer with inertia under force, as a host sees them: momentum and energy of the layer between the masses of
// the host. tests/convergence compares with exact solutions, tests/property with the twin.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "tests/support/random_physics.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

double mass_behind(const Rig& rig, int lane) {
  const ModelOptions& options = rig.model.options();
  return rig.inputs.mass_soft[lane] - options.soft.density * options.grid.thickness;
}

// Mean velocity of the layer and the mass behind it, relative to the hard body.
double mean_velocity(const Rig& rig, int lane) {
  const Grid& grid = rig.model.grid();
  const int n = grid.num_cells();
  double momentum = mass_behind(rig, lane) * velocity_in(rig, n, lane);
  for (int c = 0; c < n; ++c) momentum += rig.model.options().soft.density * grid.width[c] * velocity_in(rig, c, lane);
  return momentum / rig.inputs.mass_soft[lane];
}

// The jump that the host's own balance (61) leaves is that of layer and mass, whatever slips, flows or opens.
TEST(PhysicsInertiaForced, TheHostsJumpIsThatOfTheLayerAndTheMassBehindIt) {
  Draw draw(71);
  int closed = 0, slipping = 0, flowing = 0;
  for (int scene = 0; scene < 60; ++scene) {
    Rig rig(random_forced_inertia_options(draw, false));
    for (int step = 0; step < 15; ++step) {
      random_inputs(draw, rig, false);
      if (step > 0 && draw.chance(0.7)) std::copy_n(rig.outputs.velocity_jump_new, kLanes, rig.inputs.velocity_jump);
      rig.step(random_dt(draw, false));
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(rig.outputs.outcome[l] & kFailed, 0) << scene << ' ' << step << ' ' << l;
        const double dt = rig.operators->dt();
        double size = std::abs(rig.inputs.velocity_jump[l]) +
                      dt * (std::abs(rig.inputs.stress_soft[l]) / rig.inputs.mass_soft[l] +
                            std::abs(rig.inputs.stress_hard[l]) / rig.inputs.mass_hard[l] +
                            std::abs(rig.outputs.shear_stress[l]) *
                                (1.0 / rig.inputs.mass_soft[l] + 1.0 / rig.inputs.mass_hard[l]));
        for (int c = 0; c <= rig.model.grid().num_cells(); ++c) size = std::max(size, std::abs(velocity_in(rig, c, l)));
        ASSERT_NEAR(mean_velocity(rig, l), rig.outputs.velocity_jump_new[l], 1e-11 * size)
            << scene << ' ' << step << ' ' << l;
        closed += rig.outputs.regime[l] != Regime::kOpen;
        slipping += rig.outputs.regime[l] != Regime::kOpen && rig.outputs.sliding_velocity[l] != 0.0;
        flowing += rig.plastic_slip(l) > rig.plastic_slip_of(rig.trial, l);
      }
    }
  }
  EXPECT_GT(std::min({closed, slipping, flowing}), 500);
}

// An elastic layer whose interface sticks: after a push the energy of both bodies, of the layer and its elasticity never
// grows, in either order.
TEST(PhysicsInertiaForced, AnElasticLayerNeverGainsEnergy) {
  for (const bool stages : {false, true}) {
    ModelOptions options = with_inertia(graded(paper_options(Strategy::kForceDriven)));
    options.plastic_layer = true;
    options.soft.yield_strength = 1e12;
    options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
    options.interface = {.friction_coefficient = 1e3, .yield_strength = 1e12};
    if (stages) options = of_second_order(options);
    Rig rig(options, 1);
    rig.set_all(0.0, 11.2e9);
    const double dt = 0.3e-9;
    double hard = 0.0, energy = 0.0, before = 0.0;
    for (int n = 0; n < 400; ++n) {
      for (int l = 0; l < kLanes; ++l) {
        rig.inputs.mass_soft[l] = 0.08;
        rig.inputs.mass_hard[l] = 0.02;
        rig.inputs.stress_soft[l] = n < 20 ? 4e8 : 0.0;
        rig.inputs.stress_hard[l] = n < 10 ? -3e8 : 0.0;
        if (n > 0) rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
      }
      rig.step(dt);
      ASSERT_EQ(rig.outputs.regime[0], Regime::kStick) << n;
      ASSERT_EQ(rig.outputs.friction_heat[0], 0.0) << n;
      hard += dt * (rig.outputs.shear_stress[0] - rig.inputs.stress_hard[0]) / rig.inputs.mass_hard[0];
      const Grid& grid = rig.model.grid();
      const auto kinetic = [](double mass, double v) { return 0.5 * mass * v * v; };
      energy = kinetic(rig.inputs.mass_hard[0], hard) +
               kinetic(mass_behind(rig, 0), hard + velocity_in(rig, grid.num_cells()));
      for (int c = 0; c < grid.num_cells(); ++c)
        energy += kinetic(options.soft.density * grid.width[c], hard + velocity_in(rig, c));
      for (int i = 0; i <= grid.num_cells(); ++i)
        energy += 0.5 * grid.weight[i] * std::pow(stress_at(rig, i), 2) / options.soft.shear_modulus;
      if (n > 20) {
        ASSERT_LE(energy, before * (1.0 + 1e-12)) << n;
      }
      before = energy;
    }
    EXPECT_GT(energy, 0.0);
  }
}

// A contact that closes later: the layer flies with the soft body, without stress, and meets the hard body as one. Until its
// wave comes back from z = h the hard body follows m V' = s, s = Z (V0 - V).
TEST(PhysicsInertiaForced, ALayerThatFliesMeetsTheHardBodyAtTheSpeedOfItsHost) {
  ModelOptions options = with_inertia(paper_options(Strategy::kForceDriven));
  options.plastic_layer = true;
  options.soft.yield_strength = 1e12;
  options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
  options.interface = {.friction_coefficient = 1e3, .yield_strength = 1e12};
  options.grid.cells = 400;
  Rig rig(options, 1);
  constexpr double kPush = 1e9, kMassHard = 0.03, kMassSoft = 0.08, kDt = 0.025e-9, kFront = 0.25e-9;
  constexpr int kFlies = 40, kMeets = 200;
  const double Z = impedance(options.soft);
  double jump = 15.0, worst = 0.0;
  for (int n = 0; n < kFlies + kMeets; ++n) {
    const bool flies = n < kFlies;
    rig.set_all(jump, flies ? -1.0 : 5e8);
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.mass_soft[l] = kMassSoft;
      rig.inputs.mass_hard[l] = kMassHard;
      rig.inputs.stress_soft[l] = flies ? kPush : 0.0;
    }
    rig.step(kDt);
    jump = rig.outputs.velocity_jump_new[0];
    const double met = 15.0 + kFlies * kDt * kPush / kMassSoft, t = (n + 1 - kFlies) * kDt;
    if (flies) {
      ASSERT_EQ(rig.outputs.regime[0], Regime::kOpen);
      ASSERT_EQ(rig.outputs.shear_stress[0], 0.0);
      for (int c = 0; c <= rig.model.grid().num_cells(); ++c) ASSERT_EQ(velocity_in(rig, c), jump);
      if (n + 1 == kFlies) {
        ASSERT_NEAR(jump, met, 1e-12 * met);
      }
    } else if (t > kFront) {
      worst = std::max(worst, std::abs(stress_at(rig, 0) / (Z * met) - std::exp(-Z * t / kMassHard)));
    }
  }
  std::printf("a layer that meets the hard body at 15.5 m/s: s(0) to %.1e of Z V0 in 5 ns\n", worst);
  EXPECT_LT(worst, 3e-3);
}

// A host without any mass behind the layer has no answer, and keeps its state; the server refuses it before.
TEST(PhysicsInertiaForced, AHalfZoneLighterThanTheLayerHasNoAnswer) {
  ModelOptions options = with_inertia(graded(paper_options(Strategy::kForceDriven)));
  options.plastic_layer = true;
  Rig rig(options);
  rig.set_all(100.0, 11.2e9);
  rig.step(1e-9);
  const std::vector<double> before = rig.committed;
  const double layer = options.soft.density * options.grid.thickness;
  rig.inputs.mass_soft[3] = layer * (1.0 - 1e-12);
  rig.step(1e-9);
  for (int l = 0; l < kLanes; ++l) EXPECT_EQ((rig.outputs.outcome[l] & kFailed) != 0, l == 3) << l;
  for (std::size_t i = 3; i < before.size(); i += kLanes) ASSERT_EQ(rig.committed[i], before[i]);
}

}  // namespace
}  // namespace shearbus::testing
