// Sleep of nodes at rest (server/physics/METHODS.md, "Sleep"): a model with sleep must give the same answers as the
// model without sleep.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

using Change = std::function<void(ModelOptions&)>;

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

// A random history of inputs, from a host in which a constant mass lies on each side of the interface. Each lane (node)
// changes at times of its own between these phases: it slides, stops, sticks, is sheared slowly, is loaded or unloaded
// by the far stresses, opens, and closes again.
class History {
 public:
  History(unsigned seed, const ModelOptions& options)
      : forced_(options.strategy == Strategy::kForceDriven), drive_(options.drive), random_(seed) {
    for (int l = 0; l < kLanes; ++l) begin(l);
  }
  double dt() { return std::exp(std::uniform_real_distribution<>(std::log(2e-10), std::log(2e-8))(random_)); }
  void fill(TileInputs& in, const TileOutputs& last) {
    for (int l = 0; l < kLanes; ++l) {
      if (--left_[l] < 0) begin(l);
      if (lets_go_[l])
        shear_[l] = std::abs(last.shear_stress[l]) < held_[l] ? 0.0 : -std::copysign(1e4, last.shear_stress[l]);
      const bool at_interface = drive_ == Drive::kInterfaceSlip;
      in.pressure[l] = open_[l] ? -1e8 : pressure_[l];
      in.mass_soft[l] = in.mass_hard[l] = 0.1;
      in.stress_soft[l] = in.stress_hard[l] = left_[l] % 40 < 20 ? pull_[l] : -pull_[l];
      in.velocity_jump[l] = jump_[l] + (at_interface ? 0.0 : shear_[l] * kThickness);
      if (forced_ && !kicked_[l]) in.velocity_jump[l] = last.velocity_jump_new[l];
      in.soft_shear_rate[l] = shear_[l];
      in.soft_plastic_strain_rate[l] = shear_[l];
      kicked_[l] = false;
    }
  }

 private:
  static constexpr double kThickness = 20e-6;  // thickness of the layer [m]
  void begin(int l) {
    std::uniform_real_distribution<> unit(0.0, 1.0);
    open_[l] = unit(random_) < 0.3;
    const bool pushed = unit(random_) < 0.4;
    pressure_[l] = 1e9 + 10e9 * unit(random_);
    pull_[l] = (unit(random_) < 0.2 ? 500e6 : 40e6) * (unit(random_) - 0.5);
    held_[l] = 20e6 + 130e6 * unit(random_);
    jump_[l] = pushed ? 150.0 * (unit(random_) - 0.5) : 0.0;
    shear_[l] = !pushed && unit(random_) < 0.3 ? 2e4 * (unit(random_) - 0.5) : 0.0;
    lets_go_[l] = !pushed && !forced_ && shear_[l] == 0.0;
    kicked_[l] = pushed;
    left_[l] = static_cast<int>(120.0 * unit(random_));
  }
  bool forced_;
  Drive drive_;
  std::mt19937 random_;
  int left_[kLanes] = {};
  bool open_[kLanes] = {}, kicked_[kLanes] = {}, lets_go_[kLanes] = {};
  double pressure_[kLanes] = {}, pull_[kLanes] = {}, held_[kLanes] = {};
  double jump_[kLanes] = {}, shear_[kLanes] = {};
};

class Sleep : public ::testing::TestWithParam<std::size_t> {
 protected:
  ModelOptions options() const { return cases()[GetParam()].options; }
};

// Two models step through the same histories, one with sleep and one without. Their answers may differ by rounding
// only.
TEST_P(Sleep, AnswersAreThoseOfNodesThatAreSolved) {
  double apart_T = 0.0, apart_s = 0.0, apart_heat = 0.0;
  int asleep = 0, stuck = 0, woke = 0, flowed = 0;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Rig sleeper(sleeping(options())), solved(options());
    History history(seed, options());
    std::uint32_t slept = 0;
    for (int n = 0; n < 600; ++n) {
      history.fill(sleeper.inputs, solved.outputs);
      solved.inputs = sleeper.inputs;
      const double dt = history.dt();
      sleeper.step(dt);
      solved.step(dt);
      TileLedger mine, theirs;  // step() swaps the states: `trial` holds the old state, `committed` the new one
      sleeper.model.record_energy(*sleeper.operators, sleeper.inputs, sleeper.outputs, sleeper.trial.data(),
                                  sleeper.committed.data(), mine);
      solved.model.record_energy(*solved.operators, solved.inputs, solved.outputs, solved.trial.data(),
                                 solved.committed.data(), theirs);
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(sleeper.outputs.regime[l], solved.outputs.regime[l]) << "step " << n << ", lane " << l;
        ASSERT_EQ(sleeper.outputs.outcome[l] & ~kAsleep, solved.outputs.outcome[l]);
        const bool sleeps = (sleeper.outputs.outcome[l] & kAsleep) != 0;
        asleep += sleeps;
        stuck += sleeps && sleeper.outputs.regime[l] == Regime::kStick && sleeper.outputs.shear_stress[l] != 0.0;
        const bool wakes = !sleeps && (slept >> l & 1u) != 0;
        woke += wakes;
        flowed += wakes && sleeper.outputs.friction_heat[l] == 0.0;
        slept = (slept & ~(1u << l)) | static_cast<std::uint32_t>(sleeps) << l;
        apart_T = std::max(
            apart_T, std::abs(sleeper.outputs.interface_temperature[l] - solved.outputs.interface_temperature[l]));
        ASSERT_NEAR(sleeper.model.interface_temperature(sleeper.committed.data(), l),
                    sleeper.outputs.interface_temperature[l], 1e-11);
        apart_s = std::max(apart_s, std::abs(sleeper.outputs.shear_stress[l] - solved.outputs.shear_stress[l]));
        for (const LedgerTerm term : {LedgerTerm::kStoredSoft, LedgerTerm::kStoredHard, LedgerTerm::kHeatResidual})
          apart_heat = std::max(apart_heat, std::abs(mine(term, l) - theirs(term, l)));
      }
    }
  }
  EXPECT_GT(asleep, 2000);
  EXPECT_GT(stuck, 300);
  EXPECT_GT(woke, 20);
  // Plastic heating magnifies rounding in the band that flows; 1.0e-12 K and 5.4e-7 Pa in all other models.
  const bool magnifies = options().taylor_quinney_factor.has_value();
  EXPECT_LT(apart_T, magnifies ? 2e-9 : 1e-11);
  EXPECT_LT(apart_s, magnifies ? 1e-3 : 1e-5);
  EXPECT_LT(apart_heat, 1e-8);  // largest difference of the stored heat [J/m2]; about 10 kJ/m2 are stored
  printf(
      "%s: asleep %d node-steps, %d of them stuck under stress, woke %d times, %d without heat; apart by %.1e K, "
      "%.1e Pa, %.1e J/m2\n",
      cases()[GetParam()].name.c_str(), asleep, stuck, woke, flowed, apart_T, apart_s, apart_heat);
}

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

// The bits of a lane do not depend on the other lanes: they are the same when the lane is alone in its tile.
TEST_P(Sleep, LanesDoNotLookAtEachOther) {
  Rig together(sleeping(options()));
  std::vector<Rig> alone;
  alone.reserve(kLanes);
  for (int l = 0; l < kLanes; ++l) alone.emplace_back(sleeping(options()), 1u << l);
  History history(7, options());
  const std::size_t doubles = together.model.layout().doubles;
  for (int n = 0; n < 300; ++n) {
    history.fill(together.inputs, together.outputs);
    const double dt = history.dt();
    for (int l = 0; l < kLanes; ++l) {
      alone[static_cast<std::size_t>(l)].inputs = together.inputs;
      alone[static_cast<std::size_t>(l)].inputs.active = 1u << l;
    }
    together.step(dt);
    for (int l = 0; l < kLanes; ++l) {
      Rig& one = alone[static_cast<std::size_t>(l)];
      one.step(dt);
      for (std::size_t i = static_cast<std::size_t>(l); i < doubles; i += kLanes)
        ASSERT_EQ(std::bit_cast<std::uint64_t>(one.committed[i]), std::bit_cast<std::uint64_t>(together.committed[i]))
            << "step " << n << ", lane " << l << ", row " << i / kLanes;
    }
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
