// Plastic work heats the layer where it flows (server/physics/MODEL.md, "Plastic-work heating"): T = T_ad + s w B_phi,
// with the temperature T_ad without this heat, the stress s, the imposed jump w, and the temperature rise B_phi by a
// unit flux that is distributed like the flow.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kDt = 1e-9;  // step length [s]

ModelOptions heated(ModelOptions options, double factor = 1.0) {
  options = two_sided(options);
  options.taylor_quinney_factor = factor;
  return options;
}

int hottest(const Rig& rig) {
  int at = 0;
  for (int i = 1; i < rig.model.grid().num_vertices(); ++i) at = rig.T(i) > rig.T(at) ? i : at;
  return at;
}

// B_phi is the temperature rise in one step by a heat flux of 1 W/m2 that is distributed over the vertices in the
// shares phi. If all heat enters at z = 0, B_phi equals the response of the heat operator. For any phi, B_phi contains
// exactly the heat of one step, summed over both bodies.
TEST(PhysicsPlasticHeating, ResponseHoldsExactlyTheHeatOfOneStep) {
  const ModelOptions o = paper_options();
  for (FarBoundary far : {FarBoundary::kInsulated, FarBoundary::kHalfSpace}) {
    for (double grading : {1.0, 1.08}) {
      const Grid layer({20e-6, 60, grading, far});
      const HeatGrid grid(layer, far, Grid({6e-6, 40, 1.1, far}), far);
      for (double dt : {1e-12, 1e-9, 1e-5}) {
        const HeatOperator heat(grid, o.soft, o.hard, dt);
        const SpreadHeat spread(grid, dt, layer.num_vertices(), o.soft, o.hard);
        std::vector<double> shape(layer.num_vertices() * kLanes, 0.0), response(shape.size());
        for (std::size_t i = 0; i < shape.size() / kLanes; ++i) {
          shape[i * kLanes + 1] = layer.weight[i] / layer.vertex.back();
          shape[i * kLanes + 2] = i == 30 ? 1.0 : 0.0;
          shape[i * kLanes + 3] = i == 60 ? 1.0 : 0.0;
        }
        shape[0] = 1.0;
        respond(heat, spread, shape.data(), response.data());
        const double flux[kLanes] = {1.0, 1.0, 1.0, 1.0};
        std::vector<double> T(static_cast<std::size_t>(grid.num_vertices()) * kLanes, 0.0);
        add_spread(heat, spread, flux, response.data(), T.data());
        double stored[4] = {};
        for (std::size_t i = 0; i < T.size() / kLanes; ++i) {
          const double capacity = grid.capacity(static_cast<int>(i), o.soft, o.hard);
          for (std::size_t l = 0; l < 4; ++l) stored[l] += capacity * T[i * kLanes + l];
          ASSERT_NEAR(T[i * kLanes], heat.response[i], 1e-12 * heat.response[grid.interface]) << i << ", dt " << dt;
          ASSERT_EQ(T[i * kLanes + 4], 0.0);
        }
        for (int l = 0; l < 4; ++l) EXPECT_NEAR(stored[l] / dt, 1.0, 1e-12) << "lane " << l << ", dt " << dt;
      }
    }
  }
}

// The paper's case: the hottest place moves from the interface into the soft metal.
TEST(PhysicsPlasticHeating, PaperCaseIsHotInsideAndColdAtTheInterface) {
  const ModelOptions options = heated(paper_options());
  Rig rig(options, 1), surface(two_sided(paper_options()), 1);
  double work = 0.0, heat = 0.0;
  const double e = options.soft.conductivity / std::sqrt(options.soft.diffusivity) +
                   options.hard.conductivity / std::sqrt(options.hard.diffusivity);
  for (int n = 1; n <= 1000; ++n) {
    for (Rig* r : {&rig, &surface}) {
      r->set_all(100.0, 11.2e9);
      r->step(kDt);
    }
    work += rig.stress() * 100.0 * kDt;
    heat += rig.outputs.friction_heat[0];
    ASSERT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-10) << n;
    // No vertex may melt, so the work is bounded by the heat that the bodies can take: the layer holds at most its heat
    // at melting, and the rest flows into the bodies from faces that are at most at the melting temperature.
    const double most = 20e-6 * options.soft.conductivity / options.soft.diffusivity * (1220 - 300) +
                        2 * e * (1220 - 300) * std::sqrt(n * kDt / M_PI);
    ASSERT_LE(work, most) << n;
  }
  EXPECT_NEAR(heat / work, 1.0, 1e-12);
  EXPECT_NEAR(rig.T(0), 440.0, 0.5);
  EXPECT_NEAR(rig.T(hottest(rig)), 1219.3, 0.5);
  EXPECT_GT(rig.model.grid().vertex[hottest(rig)], 10e-6);
  EXPECT_NEAR(rig.stress() / 1e6, 83.8, 0.5);
  EXPECT_NEAR(surface.stress() / 1e6, 142.6, 0.1);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kMelting);
}

// Slip beyond the Coulomb limit is slip of the interface: its work heats z = 0 only, as without plastic-work heating.
TEST(PhysicsPlasticHeating, SlipOfTheInterfaceHeatsTheInterface) {
  ModelOptions options = graded(paper_options());
  options.friction_coefficient = 0.3;
  Rig rig(heated(options, 0.9), 1), surface(two_sided(options), 1);
  for (Rig* r : {&rig, &surface}) r->set_all(100.0, 0.2e9);
  for (int n = 0; n < 5; ++n) {
    rig.step(kDt);
    surface.step(kDt);
  }
  EXPECT_EQ(rig.outputs.regime[0], Regime::kCoulomb);
  EXPECT_EQ(rig.heat_shape(0), 1.0);
  const double before = rig.T(0) - surface.T(0);
  for (int n = 0; n < 200; ++n) {
    rig.step(kDt);
    surface.step(kDt);
    ASSERT_NEAR(rig.outputs.friction_heat[0] / surface.outputs.friction_heat[0], 1.0, 1e-13);
  }
  EXPECT_NEAR(rig.T(0), surface.T(0), std::abs(before));  // the difference left by the first five steps has shrunk
}

}  // namespace
}  // namespace shearbus::testing
