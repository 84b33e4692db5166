// A flow law that the server lacks is added by one file and one line in the list of laws. The complete velocity-driven
// step then works with this law.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "server/physics/solver/parts.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

static_assert(FlowLawClass<Bingham>);

ModelOptions bingham_options() {
  ModelOptions options = graded(paper_options(), 40, 1.1);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.soft.flow_law = FlowLaws::place<Bingham>();
  options.soft.yield_strength = 200e6;
  options.soft.hardening_modulus = 20.0;  // the viscosity eta [Pa s]: 100 MPa at a rate of 5e6 1/s
  return options;
}

// Checks every equation of the step: the flow law at each vertex for its plastic strain increment, the balance of
// elastic and plastic shear, and the heat.
TEST(PhysicsOwnLaw, IsSolvedThroughTheFullVelocityDrivenStep) {
  Rig rig(bingham_options());
  const ModelOptions& options = rig.model.options();
  const Grid& grid = rig.model.grid();
  const double dt = 1e-9, G = options.soft.shear_modulus, h = options.grid.thickness;
  double stress_before[kLanes] = {};
  int flowed = 0, hot = 0;
  for (int n = 0; n < 400; ++n) {
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.velocity_jump[l] = (n % 100 < 80 ? 1.0 : -0.5) * std::pow(10.0, 3.0 * l / (kLanes - 1));
      rig.inputs.pressure[l] = 10e9;
    }
    rig.step(dt);
    for (int l = 0; l < kLanes; ++l) {
      ASSERT_EQ(rig.outputs.outcome[l] & kFailed, 0);
      const double s = rig.stress(l), V = rig.inputs.velocity_jump[l];
      double plastic = 0.0;
      for (int i = 0; i < grid.num_vertices(); ++i) {
        const double g = 1.0 - rig.T(i, l) / options.soft.melting_temperature;
        const double dep = rig.ep(i, l) - rig.ep_of(rig.trial, i, l);
        const double expected = std::max(
            0.0, dt * (kSqrt3 * std::abs(s) / g - options.soft.yield_strength) / (options.soft.hardening_modulus * g));
        ASSERT_NEAR(dep, expected, 1e-9 * expected + 1e-13) << "vertex " << i << ", lane " << l << ", step " << n;
        plastic += grid.weight[static_cast<std::size_t>(i)] * dep;
        flowed += dep > 0.0;
      }
      const double elastic = (s - stress_before[l]) * h / G;
      ASSERT_NEAR(elastic + std::copysign(kSqrt3 * plastic, s), V * dt, 1e-8 * std::abs(V) * dt + 1e-18);
      hot += rig.T(0, l) > 600.0;
      stress_before[l] = s;
    }
  }
  EXPECT_GT(flowed, 10000);
  EXPECT_GT(hot, 100);
}

TEST(PhysicsOwnLaw, ItsPropertiesRefuseWhatItCannotDo) {
  EXPECT_TRUE(properties_of(FlowLaws::place<Bingham>()).first_order_in_time);
  EXPECT_EQ(discretised(bingham_options(), 1e-2).time_integrator, TimeIntegrator::kBackwardEuler);
  const auto refused_key = [](const auto& change) {
    ModelOptions options = bingham_options();
    change(options);
    const std::vector<Refusal> found = refusals(options);
    return found.empty() ? std::string() : found.front().key;
  };
  EXPECT_EQ(refused_key([](ModelOptions&) {}), "");
  EXPECT_EQ(refused_key([](ModelOptions& o) { o.inertia = true; }), "");
  EXPECT_EQ(refused_key([](ModelOptions& o) { o.time_integrator = TimeIntegrator::kSdirk2; }), "");
  EXPECT_EQ(refused_key([](ModelOptions& o) { o.soft.pressure_term = PressureTerm::kCompressed; }),
            "soft.pressure_term");
}

}  // namespace
}  // namespace shearbus::testing
