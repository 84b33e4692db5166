// The energy of a layer with inertia whose plastic work heats in place, in random scenes, states and inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "tests/support/random_physics.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

// What a step does to the energies of motion and strain, a half each of `half` times a square: their growth, what backward
// Euler loses of it, and the size of both.
struct Energies {
  double kept = 0.0, lost = 0.0, size = 0.0;
  void add(double half, double now, double old) {
    kept += half * (now - old) * (now + old);
    lost += half * (now - old) * (now - old);
    size += half * (now * now + old * old);
  }
};

// What the jump does is the growth of the kinetic and the elastic energy of the layer, the heat, of which with X = 1 none
// is missing, and what backward Euler loses.
TEST(PhysicsWavesHeat, TheWorkOfTheJumpIsMotionStrainAndHeat) {
  Draw draw(61);
  double worst = 0.0, heated = 0.0, all = 0.0;
  int steps = 0;
  for (int scene = 0; scene < 60; ++scene) {
    ModelOptions options = of_first_order(random_inertia_heat_options(draw, false));
    options.taylor_quinney_factor = 1.0;
    Rig rig(options);
    rig.inputs.wants_mean_stress = true;
    const Grid& grid = rig.model.grid();
    const TileLayout& layout = rig.model.layout();
    for (int n = 0; n < 15; ++n) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        const bool closes = rig.trial[place(layout.regime, 0, l)] == static_cast<double>(Regime::kOpen);
        if (rig.inputs.pressure[l] <= 0.0 || closes) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        ASSERT_EQ(rig.outputs.mean_shear_stress[l], stress_at(rig, 0, l));
        const double work = rig.outputs.mean_far_stress[l] * rig.inputs.velocity_jump[l] * dt;
        Energies sums{.size = std::abs(work)};
        for (int i = 0; i <= grid.num_cells(); ++i) {
          const std::size_t at = static_cast<std::size_t>(i);
          sums.add(0.5 * grid.weight[at] / options.soft.shear_modulus, stress_at(rig, i, l),
                   rig.trial[place(layout.shear_stress, i, l)]);
          if (i < grid.num_cells())
            sums.add(0.5 * options.soft.density * grid.width[at], velocity_in(rig, i, l),
                     rig.trial[place(layout.layer_velocity, i, l)]);
        }
        const double heat = rig.outputs.friction_heat[l];
        worst = std::max(worst, std::abs(work - sums.kept - sums.lost - heat) / sums.size);
        ASSERT_NEAR(work, sums.kept + sums.lost + heat, 1e-9 * sums.size);
        heated += heat;
        all += sums.size;
        ++steps;
      }
    }
  }
  std::printf("%d node-steps: worst %.1e of the energies, %.2f of which are heat\n", steps, worst, heated / all);
  EXPECT_GT(steps, 3000);
  EXPECT_GT(heated, 0.01 * all);
}

// The same under force, of what the far stresses and the host's plastic shear do. In the frame in which the hard body rests
// before the step both masses of the host move as well.
TEST(PhysicsWavesHeat, TheWorkOfTheFarStressesIsMotionStrainAndHeat) {
  Draw draw(62);
  double worst = 0.0, heated = 0.0, all = 0.0;
  int steps = 0;
  for (int scene = 0; scene < 40; ++scene) {
    ModelOptions options = of_first_order(random_forced_inertia_heat_options(draw, false));
    options.taylor_quinney_factor = 1.0;
    Rig rig(options);
    const Grid& grid = rig.model.grid();
    const TileLayout& layout = rig.model.layout();
    const int n = grid.num_cells();
    for (int step = 0; step < 15; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      const TileInputs in = rig.inputs;
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        const bool closes = rig.trial[place(layout.regime, 0, l)] == static_cast<double>(Regime::kOpen);
        if (in.pressure[l] <= 0.0 || closes) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(step) + ", lane " +
                     std::to_string(l));
        const auto mass = [&](int c) {
          return c < n ? options.soft.density * grid.width[static_cast<std::size_t>(c)]
                       : in.mass_soft[l] - options.soft.density * grid.vertex.back();
        };
        const auto before = [&](int c) { return rig.trial[place(layout.layer_velocity, c, l)]; };
        double ahead = 0.0;  // of the jump that the host tells
        for (int c = 0; c <= n; ++c) ahead += mass(c) * (before(c) - in.velocity_jump[l]);
        const double hard = (stress_at(rig, 0, l) - in.stress_hard[l]) * (dt / in.mass_hard[l]);
        const double soft = velocity_in(rig, n, l) + hard;
        const double drive = kSqrt3 * options.grid.thickness * in.soft_plastic_strain_rate[l];
        double work = 0.0;
        Energies sums;
        for (const double of : {in.stress_soft[l] * soft, -in.stress_hard[l] * hard, stress_at(rig, n, l) * drive}) {
          work += of * dt;
          sums.size += std::abs(of) * dt;
        }
        for (int i = 0; i <= n; ++i)
          sums.add(0.5 * grid.weight[static_cast<std::size_t>(i)] / options.soft.shear_modulus, stress_at(rig, i, l),
                   rig.trial[place(layout.shear_stress, i, l)]);
        for (int c = 0; c <= n; ++c)
          sums.add(0.5 * mass(c), velocity_in(rig, c, l) + hard, before(c) - ahead / in.mass_soft[l]);
        sums.add(0.5 * in.mass_hard[l], hard, 0.0);
        const double heat = rig.outputs.friction_heat[l];
        worst = std::max(worst, std::abs(work - sums.kept - sums.lost - heat) / sums.size);
        ASSERT_NEAR(work, sums.kept + sums.lost + heat, 1e-9 * sums.size);
        heated += heat;
        all += sums.size;
        ++steps;
      }
    }
  }
  std::printf("%d node-steps under force: worst %.1e of the energies, %.2f of which are heat\n", steps, worst,
              heated / all);
  EXPECT_GT(steps, 2000);
  EXPECT_GT(heated, 1e-3 * all);
}

}  // namespace
}  // namespace shearbus::testing
