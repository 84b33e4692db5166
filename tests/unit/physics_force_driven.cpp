#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "server/physics/interface/stress_limit.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

// Sets the masses per area [kg/m2] of half a zone of each body: the paper's aluminium and steel in zones of width
// `zone` [m].
void set_masses(Rig& rig, double zone = 5e-6) {
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703.0 * 0.5 * zone;
    rig.inputs.mass_hard[l] = 7900.0 * 0.5 * zone;
  }
}

TEST(PhysicsForceDriven, TheStoppingStepTurnsTheKineticEnergyIntoWork) {
  Rig rig(graded(paper_options(Strategy::kForceDriven)), 1);
  set_masses(rig);
  rig.set_all(2.0, 11.2e9);
  rig.step(1e-9);
  ASSERT_EQ(rig.outputs.regime[0], Regime::kStick);
  const double reduced = 1.0 / (1.0 / rig.inputs.mass_soft[0] + 1.0 / rig.inputs.mass_hard[0]);
  const double beta_T = heat_partition(rig.model.options().soft, rig.model.options().hard);
  EXPECT_NEAR(rig.outputs.friction_heat[0] / (beta_T * 0.5 * reduced * 4.0), 1.0, 1e-13);
}

// The step of tests/measured.toml, "Exact solutions", that has three answers: zones of 5 um, dt = 1 ns, T_ad =
// 1215 K before the heat of the step, mean jump without friction [V]mid = 33.888 m/s, interface yield strength 0.68
// GPa.
struct ThreeRoots {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  ThreeRoots() {
    options.interface.yield_strength = 0.68e9;
    options.initial_temperature = 1215.0;
  }
  StressLimit limit() const { return {0.3 * 11.2e9, 0.68e9 / kSqrt3, 11.2e9, &options.soft}; }
  FrictionHeating heating() const {
    // measured.toml computes B0, the temperature rise per unit flux at z = 0, for a half-space without a grid.
    const double B0 = std::sqrt(options.soft.diffusivity * 1e-9) / options.soft.conductivity;
    const double b = 0.5 * 1e-9 * (1 / (2703 * 2.5e-6) + 1 / (7900 * 2.5e-6));
    return {1215.0, heat_partition(options.soft, options.hard) * B0, 33.888, b};
  }
};

TEST(PhysicsForceDriven, AStepNearMeltingHasThreeAnswers) {
  const ThreeRoots example;
  const StressLimit limit = example.limit();
  const FrictionHeating heating = example.heating();
  const double a_stick = heating.c / heating.b;
  std::vector<double> T0;
  double before = 0.0;
  for (int i = 1; i <= 20000; ++i) {
    const double a = a_stick * i / 20000.0;
    if ((spare_strength(limit, heating, before) > 0) != (spare_strength(limit, heating, a) > 0)) {
      T0.push_back(heating.temperature(0.5 * (a + before)));
    }
    before = a;
  }
  ASSERT_EQ(T0.size(), 2u);  // temperatures of the two slipping answers; the third answer sticks
  EXPECT_NEAR(T0[0], 1218.688, 0.001);
  EXPECT_NEAR(T0[1], 1218.161, 0.001);
  EXPECT_GE(spare_strength(limit, heating, a_stick), 0.0);
  EXPECT_EQ(heating.temperature(a_stick), 1215.0);

  EXPECT_FALSE(slip_is_unique(limit, heating, a_stick));
  const SlipSearch slip = most_slip_stress(limit, heating, a_stick);
  EXPECT_TRUE(slip.found);
  EXPECT_TRUE(slip.several || spare_strength(limit, heating, a_stick) >= 0.0);
  EXPECT_NEAR(heating.temperature(slip.stress), 1218.688, 0.001);
  EXPECT_NEAR(spare_strength(limit, heating, slip.stress) / slip.stress, 0.0, 1e-10);
}

TEST(PhysicsForceDriven, AStepWithSeveralAnswersIsDivided) {
  const ThreeRoots example;
  for (Regime previous : {Regime::kStick, Regime::kTresca}) {
    Rig rig(example.options, 1);
    set_masses(rig);
    rig.set_all(0.0, 11.2e9);
    rig.committed[rig.model.layout().regime] = static_cast<double>(previous);
    rig.inputs.stress_soft[0] = 2 * 33.888 / 1e-9 * rig.inputs.mass_soft[0];
    const double heat_before = rig.stored_heat(300.0);
    rig.step(1e-9);
    EXPECT_EQ(rig.outputs.outcome[0], kSubstepped);
    // The node sticks, whatever its previous regime was: the substeps are so short that each of them has only one
    // answer.
    EXPECT_EQ(rig.outputs.regime[0], Regime::kStick);
    EXPECT_EQ(rig.outputs.velocity_jump_new[0], 0.0);
    EXPECT_NEAR(rig.stored_heat(300.0) - heat_before, rig.outputs.friction_heat[0], 1e-9 * heat_before);
  }
}

}  // namespace
}  // namespace shearbus::testing
