// Checks the bound on friction below melting (server/physics/MODEL.md, "What friction can do below melting") on every
// node and after every step of random histories: the work per area, integral s [v] dt, is at most
// 2 e (T_melt - T_start) sqrt(t/pi).
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

#include "tests/support/physics_rig.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

struct Case {
  std::string name;
  ModelOptions options;
};

std::vector<Case> cases() {
  const ModelOptions insulated = graded(paper_options(Strategy::kForceDriven));
  ModelOptions half_space = insulated;
  half_space.grid.far_boundary = FarBoundary::kHalfSpace;
  ModelOptions second_order = half_space;
  second_order.time_integrator = TimeIntegrator::kSdirk2;
  ModelOptions modes = second_order;
  modes.modes = ModesOptions{.accuracy = 1e-4, .shortest_step = 1e-11, .longest_time = 1e-4};
  ModelOptions lindemann = half_space;
  lindemann.soft.melting_curve = MeltingCurve::kLindemann;
  lindemann.soft.yield_strength_max = lindemann.interface.yield_strength = 0.68e9;
  ModelOptions junctions = half_space;
  junctions.junctions = JunctionOptions{.contact_fraction = 0.5, .height = 1e-6, .metal = half_space.soft};
  return {{"Insulated", insulated}, {"HalfSpace", half_space}, {"SecondOrder", second_order},      {"Modes", modes},
          {"Lindemann", lindemann}, {"Junctions", junctions},  {"TwoSided", two_sided(half_space)}};
}

double effusivity(const Material& m) {
  return m.conductivity / std::sqrt(m.diffusivity);
}

class PhysicsHeatBound : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsHeatBound, HoldsForEveryNodeAndTime) {
  const ModelOptions& options = GetParam().options;
  constexpr int kHistories = 10, kSteps = 400;
  double most_used = 0.0;
  for (int history = 0; history < kHistories; ++history) {
    Draw draw(static_cast<std::uint64_t>(history) + 1);
    Rig rig(options);
    double work[kLanes] = {}, time[kLanes] = {}, melting[kLanes] = {}, speed[kLanes], pressure[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.mass_soft[l] = 2703.0 * 1e-4;
      rig.inputs.mass_hard[l] = 7900.0 * 1e-4;
      speed[l] = draw.log_uniform(10.0, 3000.0);
      pressure[l] = draw.log_uniform(0.1e9, 20e9);
    }
    for (int step = 0; step < kSteps; ++step) {
      const double dt = draw.log_uniform(2e-10, 5e-9);
      for (int l = 0; l < kLanes; ++l) {
        if (draw.chance(0.02)) speed[l] = draw.sign() * draw.log_uniform(10.0, 3000.0);
        if (draw.chance(0.02)) pressure[l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(0.1e9, 20e9);
        rig.inputs.velocity_jump[l] = speed[l];
        rig.inputs.pressure[l] = pressure[l];
      }
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        work[l] += rig.outputs.shear_stress[l] * rig.outputs.sliding_velocity[l] * dt;
        if (!(work[l] > 0.0)) continue;
        time[l] += dt;
        melting[l] = std::max(melting[l], at_pressure(options.soft, pressure[l]).melting_temperature);
        const double bound = 2.0 * (effusivity(options.soft) + effusivity(options.hard)) *
                             (melting[l] - options.initial_temperature) * std::sqrt(time[l] * std::numbers::inv_pi);
        ASSERT_LE(work[l], bound) << "history " << history << ", step " << step;
        most_used = std::max(most_used, work[l] / bound);
      }
    }
  }
  std::printf("bound used: %.5f\n", most_used);
  EXPECT_GT(most_used, 0.9);  // the histories come near the bound, so that the test can fail
}

INSTANTIATE_TEST_SUITE_P(, PhysicsHeatBound, ::testing::ValuesIn(cases()),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace shearbus::testing
