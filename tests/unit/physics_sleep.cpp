// Sleep of nodes at rest (server/physics/METHODS.md, "Sleep"): a model with sleep must give the same answers as the
// model without sleep. tests/property/physics_sleep.cpp compares random histories with a twin that stays awake.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

ModelOptions forced(FarBoundary far = FarBoundary::kHalfSpace) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven));
  options.grid.far_boundary = far;
  return options;
}

struct Case {
  std::string name;
  ModelOptions options;
};

std::vector<Case> cases() {
  std::vector<Case> all = {{"HalfSpace", forced()}, {"Insulated", forced(FarBoundary::kInsulated)}};
  all.push_back({"TwoSided", two_sided(forced())});
  all.push_back({"Junctions", forced()});
  all.back().options.junctions = {.contact_fraction = 0.5, .height = 1e-6, .metal = forced().soft};
  all.push_back({"PlasticLayer", two_sided(forced())});
  all.back().options.plastic_layer = true;
  all.back().options.interface.yield_strength = 300e6;
  all.push_back({"PlasticLayerOneSided", forced()});
  all.back().options.plastic_layer = true;
  all.back().options.interface.yield_strength = 300e6;
  all.back().options.soft.yield_strength_max = 400e6;
  all.back().options.soft.melting_curve = MeltingCurve::kLindemann;
  all.back().options.soft.pressure_term = PressureTerm::kCompressed;
  all.push_back({"Weakening", forced()});
  all.back().options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  all.back().options.interface.friction_coefficient_fast = 0.02;
  all.back().options.interface.velocity_decay = 0.05;
  all.push_back({"UnderPressure", forced()});
  all.back().options.soft.melting_curve = MeltingCurve::kLindemann;
  all.push_back({"LayerShear", graded(paper_options())});
  all.push_back({"CoulombLimit", graded(paper_options())});
  all.back().options.friction_coefficient = 0.01;
  all.push_back({"JohnsonCook", two_sided(graded(paper_options()))});
  all.back().options.soft = make_material("copper_ofhc_jc", {}).material;
  all.push_back({"PerfectlyPlastic", graded(paper_options())});
  all.back().options.soft.hardening_coefficient = 0.0;
  all.back().options.soft.melting_curve = MeltingCurve::kLindemann;
  all.push_back({"PlasticHeating", two_sided(graded(paper_options()))});
  all.back().options.taylor_quinney_factor = 0.9;
  all.push_back({"InterfaceSlip", graded(paper_options())});
  all.back().options.drive = Drive::kInterfaceSlip;
  return all;
}

ModelOptions sleeping(ModelOptions options) {
  options.sleep = true;
  return options;
}

class Sleep : public ::testing::TestWithParam<std::size_t> {
 protected:
  ModelOptions options() const { return cases()[GetParam()].options; }
};

// A node that never slid keeps the same bits with and without sleep, in an open contact (P < 0) and in a closed one.
TEST_P(Sleep, ANodeThatNeverMovedKeepsItsBits) {
  for (const double pressure : {-1.0, 8e9}) {
    Rig sleeper(sleeping(options())), solved(options());
    for (Rig* rig : {&sleeper, &solved}) rig->start({300.1, 317.3, 299.9, 1019.999, 400.0, 77.7, 300.0, 301.0});
    for (int n = 0; n < 200; ++n) {
      for (Rig* rig : {&sleeper, &solved}) {
        rig->set_all(n < 150 ? 0.0 : 60.0, n < 150 ? pressure : 8e9);
        rig->step(n % 2 == 0 ? 1e-9 : 3e-9);
      }
      for (int l = 0; l < kLanes; ++l) {
        const bool sleeps = sleeper.outputs.outcome[l] == kAsleep;
        ASSERT_TRUE(n < 80 || sleeps == (n < 150)) << n;  // asleep after 68 steps, a fourth of 272 vertices
        ASSERT_EQ(sleeper.outputs.interface_temperature[l], solved.outputs.interface_temperature[l]) << n;
        ASSERT_EQ(sleeper.outputs.shear_stress[l], solved.outputs.shear_stress[l]) << n;
        ASSERT_EQ(sleeper.outputs.friction_heat[l], solved.outputs.friction_heat[l]) << n;
      }
    }
    EXPECT_GT(sleeper.outputs.friction_heat[0], 0.0);  // the node wakes in the step in which the bodies move again
  }
}

// A sticking layer is loaded slowly up to its yield stress, or the pressure falls and lowers the yield stress to the
// stress of the layer. The node must wake in the step in which the layer first flows. In all steps the answers of the
// node have the bits of the model without sleep.
TEST(PhysicsSleep, AStuckLayerWakesBeforeItFlows) {
  for (const bool forced_host : {false, true}) {
    for (const bool released : {false, true}) {
      ModelOptions options = forced_host ? forced() : graded(paper_options());
      if (!forced_host) options.drive = Drive::kInterfaceSlip;  // soft_shear_rate loads the layer and causes no heat
      options.plastic_layer = forced_host;
      options.interface = {1.0, 2e9};  // an interface so strong that the layer yields first
      Rig sleeper(sleeping(options)), solved(options);
      int slept = 0, first_awake = 0, first_flow = 0;
      double stress = 0.0, stress_of_last_sleep = 0.0;
      for (int n = 0; n < 300 && first_flow == 0; ++n) {
        stress = released ? 140e6 : 1e6 * n;
        const double pressure = released ? std::max(1e5, 12e9 - 5e7 * n) : 2e9;
        for (Rig* rig : {&sleeper, &solved}) {
          rig->set_all(0.0, pressure);
          for (int l = 0; l < kLanes; ++l) {
            rig->inputs.stress_soft[l] = rig->inputs.stress_hard[l] = stress;
            const double short_of = stress - rig->stress(l);
            rig->inputs.soft_shear_rate[l] = short_of / (options.soft.shear_modulus * 1e-9);
          }
          rig->step(1e-9);
        }
        const bool sleeps = (sleeper.outputs.outcome[0] & kAsleep) != 0;
        slept += sleeps;
        if (sleeps) stress_of_last_sleep = flow_stress(options.soft, 0.0, pressure, 300.0) / kSqrt3;
        if (slept > 0 && !sleeps && first_awake == 0) first_awake = n;
        if (solved.plastic_slip() > 0.0) first_flow = n;
        ASSERT_FALSE(sleeps && first_flow > 0) << n;
        ASSERT_EQ(sleeper.outputs.shear_stress[0], solved.outputs.shear_stress[0]) << n;
        ASSERT_EQ(sleeper.plastic_slip(), solved.plastic_slip()) << n;
        ASSERT_EQ(sleeper.outputs.regime[0], solved.outputs.regime[0]) << n;
        ASSERT_EQ(sleeper.outputs.sliding_velocity[0], solved.outputs.sliding_velocity[0]) << n;
      }
      EXPECT_GT(slept, 60);
      EXPECT_EQ(first_awake, first_flow);
      EXPECT_NEAR(stress_of_last_sleep / stress, 1.0, 0.03);
    }
  }
}

std::string name_of(const ::testing::TestParamInfo<std::size_t>& param) {
  return cases()[param.param].name;
}
INSTANTIATE_TEST_SUITE_P(Models, Sleep, ::testing::Range(std::size_t{0}, cases().size()), name_of);

// The layer sticks and is still cold, but the hard body is hot deep inside. A node may sleep only if its stress is
// below the strength that the layer will have after this heat has arrived at the interface.
TEST(PhysicsSleep, HeatThatIsUnderWayInTheHardBodyIsMinded) {
  const ModelOptions options = two_sided(graded(paper_options()));
  Rig sleeper(sleeping(options)), solved(options);
  for (Rig* rig : {&sleeper, &solved}) {
    const TileLayout& layout = rig->model.layout();
    std::fill_n(rig->committed.data() + layout.hard_temperature, layout.num_hard_vertices / 4 * kLanes, 1150.0);
    for (int l = 0; l < kLanes; ++l) rig->committed[layout.shear_stress + l] = l < 4 ? 20e6 : 110e6;
  }
  std::uint32_t slept = 0;
  for (int n = 0; n < 600; ++n) {
    for (Rig* rig : {&sleeper, &solved}) {
      rig->set_all(0.0, 1e8);
      rig->step(1e-8);
    }
    for (int l = 0; l < kLanes; ++l) {
      slept |= (sleeper.outputs.outcome[l] & kAsleep) != 0 ? 1u << l : 0u;
      ASSERT_NEAR(sleeper.outputs.shear_stress[l], solved.outputs.shear_stress[l], 1e-3) << n;
    }
  }
  EXPECT_EQ(slept, 0x0fu);  // only lanes 0 to 3, which carry 20 MPa, may sleep
  EXPECT_GT(solved.plastic_slip(7), 0.0);
  EXPECT_EQ(sleeper.plastic_slip(0), 0.0);
}

}  // namespace
}  // namespace shearbus::testing
