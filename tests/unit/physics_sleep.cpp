// Nodes at rest (server/physics/MODEL.md section 3b): asleep or solved, the answers are the same.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "server/physics/layer/heat_basis.hpp"
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
  all.push_back({"Weakening", forced()});
  all.back().options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  all.back().options.interface.friction_coefficient_fast = 0.02;
  all.back().options.interface.velocity_decay = 0.05;
  all.push_back({"UnderPressure", forced()});
  all.back().options.soft.melting_curve = MeltingCurve::kLindemann;
  all.push_back({"LayerShear", graded(paper_options())});
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

// A host of rigid half zones: lanes rub, stop and stick, open for a while and close again, each in its own time.
class History {
 public:
  explicit History(unsigned seed) : random_(seed) {
    for (int l = 0; l < kLanes; ++l) begin(l);
  }
  double dt() { return std::exp(std::uniform_real_distribution<>(std::log(2e-10), std::log(2e-8))(random_)); }
  void fill(TileInputs& in, const TileOutputs& last, bool forced) {
    for (int l = 0; l < kLanes; ++l) {
      if (--left_[l] < 0) begin(l);
      in.pressure[l] = open_[l] ? -1e8 : pressure_[l];
      in.mass_minus[l] = in.mass_plus[l] = 0.1;
      in.stress_minus[l] = in.stress_plus[l] = pull_[l];
      in.velocity_jump[l] = forced && !kicked_[l] ? last.velocity_jump_new[l] : jump_[l];
      kicked_[l] = false;
    }
  }

 private:
  void begin(int l) {
    std::uniform_real_distribution<> unit(0.0, 1.0);
    open_[l] = unit(random_) < 0.5;
    const bool pushed = unit(random_) < 0.4;
    pressure_[l] = 1e9 + 10e9 * unit(random_);
    pull_[l] = 40e6 * (unit(random_) - 0.5);
    jump_[l] = pushed ? 150.0 * (unit(random_) - 0.5) : 0.0;
    kicked_[l] = pushed;
    left_[l] = static_cast<int>(120.0 * unit(random_));
  }
  std::mt19937 random_;
  int left_[kLanes] = {};
  bool open_[kLanes] = {}, kicked_[kLanes] = {};
  double pressure_[kLanes] = {}, pull_[kLanes] = {}, jump_[kLanes] = {};
};

class Sleep : public ::testing::TestWithParam<std::size_t> {
 protected:
  ModelOptions options() const { return cases()[GetParam()].options; }
  bool is_forced() const { return options().strategy == Strategy::kForceDriven; }
};

// The same histories with and without sleep. Nothing but rounding may tell them apart.
TEST_P(Sleep, AnswersAreThoseOfNodesThatAreSolved) {
  double apart_T = 0.0, apart_s = 0.0, apart_heat = 0.0;
  int asleep = 0, woke = 0;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Rig sleeper(sleeping(options())), solved(options());
    History history(seed);
    std::uint32_t slept = 0;
    for (int n = 0; n < 600; ++n) {
      history.fill(sleeper.inputs, solved.outputs, is_forced());
      solved.inputs = sleeper.inputs;
      const double dt = history.dt();
      sleeper.step(dt);
      solved.step(dt);
      TileLedger mine, theirs;  // step() has swapped the states
      sleeper.model.book(*sleeper.operators, sleeper.inputs, sleeper.outputs, sleeper.trial.data(),
                         sleeper.committed.data(), mine);
      solved.model.book(*solved.operators, solved.inputs, solved.outputs, solved.trial.data(), solved.committed.data(),
                        theirs);
      for (int l = 0; l < kLanes; ++l) {
        ASSERT_EQ(sleeper.outputs.regime[l], solved.outputs.regime[l]) << "step " << n << ", lane " << l;
        ASSERT_EQ(sleeper.outputs.outcome[l] & ~kAsleep, solved.outputs.outcome[l]);
        const bool sleeps = (sleeper.outputs.outcome[l] & kAsleep) != 0;
        asleep += sleeps;
        woke += !sleeps && (slept >> l & 1u) != 0;
        slept = (slept & ~(1u << l)) | static_cast<std::uint32_t>(sleeps) << l;
        apart_T = std::max(
            apart_T, std::abs(sleeper.outputs.interface_temperature[l] - solved.outputs.interface_temperature[l]));
        ASSERT_NEAR(sleeper.model.interface_temperature(sleeper.committed.data(), l),
                    sleeper.outputs.interface_temperature[l], 1e-8);
        apart_s = std::max(apart_s, std::abs(sleeper.outputs.shear_stress[l] - solved.outputs.shear_stress[l]));
        for (const LedgerTerm term : {LedgerTerm::kStoredSoft, LedgerTerm::kStoredHard, LedgerTerm::kHeatResidual})
          apart_heat = std::max(apart_heat, std::abs(mine(term, l) - theirs(term, l)));
      }
    }
  }
  EXPECT_GT(asleep, 2000);
  EXPECT_GT(woke, 20);
  EXPECT_LT(apart_T, 2e-9);
  EXPECT_LT(apart_s, 1e-3);
  EXPECT_LT(apart_heat, 5e-6);  // of some 10 kJ/m2
  printf("%s: asleep %d node-steps, woke %d times; apart by %.1e K, %.1e Pa, %.1e J/m2\n",
         cases()[GetParam()].name.c_str(), asleep, woke, apart_T, apart_s, apart_heat);
}

// Where nothing has ever happened, asleep or awake, the bits are the same.
TEST_P(Sleep, ANodeThatNeverMovedKeepsItsBits) {
  Rig sleeper(sleeping(options())), solved(options());
  for (Rig* rig : {&sleeper, &solved}) rig->start({300.1, 317.3, 299.9, 1019.999, 400.0, 77.7, 300.0, 301.0});
  for (int n = 0; n < 200; ++n) {
    for (Rig* rig : {&sleeper, &solved}) {
      rig->set_all(n < 150 ? 0.0 : 60.0, n < 150 ? -1.0 : 8e9);
      rig->step(n % 2 == 0 ? 1e-9 : 3e-9);
    }
    for (int l = 0; l < kLanes; ++l) {
      const bool sleeps = sleeper.outputs.outcome[l] == kAsleep;
      ASSERT_TRUE(n < 60 || sleeps == (n < 150)) << n;
      ASSERT_EQ(sleeper.outputs.interface_temperature[l], solved.outputs.interface_temperature[l]) << n;
      ASSERT_EQ(sleeper.outputs.shear_stress[l], solved.outputs.shear_stress[l]) << n;
      ASSERT_EQ(sleeper.outputs.friction_heat[l], solved.outputs.friction_heat[l]) << n;
    }
  }
  EXPECT_GT(sleeper.outputs.friction_heat[0], 0.0);  // awake in the step that moved it
}

// A lane's bits are its own: alone in its tile, or among others that sleep and wake as they like.
TEST_P(Sleep, LanesDoNotLookAtEachOther) {
  Rig together(sleeping(options()));
  std::vector<Rig> alone;
  for (int l = 0; l < kLanes; ++l) alone.emplace_back(sleeping(options()), 1u << l);
  History history(7);
  const std::size_t doubles = together.model.layout().doubles;
  for (int n = 0; n < 300; ++n) {
    history.fill(together.inputs, together.outputs, is_forced());
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
        ASSERT_EQ(std::memcmp(&one.committed[i], &together.committed[i], sizeof(double)), 0)
            << "step " << n << ", lane " << l << ", row " << i / kLanes;
    }
  }
}

// On request sleepers are solved beside, and the distance is told.
TEST_P(Sleep, AShadowTellsHowFarApartTheyAre) {
  ModelOptions shadowed = sleeping(options());
  shadowed.shadow_share = 1.0;
  Rig rig(shadowed);
  const std::size_t flag = rig.model.layout().shadowed;
  for (int l = 0; l < kLanes; l += 2) rig.committed[flag + l] = 1.0;
  History history(3);
  double worst = 0.0;
  int seen = 0;
  for (int n = 0; n < 400; ++n) {
    history.fill(rig.inputs, rig.outputs, is_forced());
    rig.step(history.dt());
    for (int l = 0; l < kLanes; ++l) {
      ASSERT_EQ(rig.committed[flag + l], l % 2 == 0 ? 1.0 : 0.0);
      if (l % 2 != 0 || !(rig.outputs.outcome[l] & kAsleep)) continue;
      ++seen;
      worst = std::max(worst, rig.outputs.shadow_temperature_error[l]);
      ASSERT_LT(rig.outputs.shadow_stress_error[l], 1.0);
    }
  }
  EXPECT_GT(seen, 200);
  EXPECT_LT(worst, 1e-8);
  // A sleeper that is not what it should be is seen.
  for (int n = 0; n < 100; ++n) {
    rig.set_all(0.0, -1.0);
    rig.step(1e-9);
  }
  rig.committed[rig.model.layout().first_temperature()] += 3.0;  // its mean temperature
  rig.step(1e-9);
  EXPECT_NEAR(rig.outputs.shadow_temperature_error[0], 3.0, 1e-6);
}

std::string name_of(const ::testing::TestParamInfo<std::size_t>& param) {
  return cases()[param.param].name;
}
INSTANTIATE_TEST_SUITE_P(Models, Sleep, ::testing::Range(std::size_t{0}, cases().size()), name_of);

// Slip and stress as vectors, which turn as they like.
TEST(PhysicsSleep, TwoComponentsSleepAsOneDoes) {
  ModelOptions options = forced();
  options.tangential_components = 2;
  Rig sleeper(sleeping(options)), solved(options);
  History first(5), second(6);
  SecondInputs across;
  SecondOutputs mine{}, theirs{};
  int asleep = 0;
  for (int n = 0; n < 500; ++n) {
    TileInputs other;
    first.fill(sleeper.inputs, solved.outputs, false);
    second.fill(other, solved.outputs, false);
    for (int l = 0; l < kLanes; ++l) {
      sleeper.inputs.velocity_jump[l] *= n % 60 < 20 ? 1.0 : 0.0;
      across.velocity_jump[l] = n % 60 < 20 ? other.velocity_jump[l] : 0.0;
      sleeper.inputs.stress_minus[l] = sleeper.inputs.stress_plus[l] = 0.0;
    }
    solved.inputs = sleeper.inputs;
    for (auto [rig, outputs] : {std::pair{&sleeper, &mine}, std::pair{&solved, &theirs}}) {
      rig->operators = rig->model.operators(1e-9);
      rig->model.advance(*rig->operators, rig->inputs, across, rig->committed.data(), rig->trial.data(), rig->outputs,
                         *outputs);
      std::swap(rig->committed, rig->trial);
    }
    for (int l = 0; l < kLanes; ++l) {
      asleep += (sleeper.outputs.outcome[l] & kAsleep) != 0;
      ASSERT_EQ(sleeper.outputs.regime[l], solved.outputs.regime[l]) << n;
      ASSERT_NEAR(sleeper.outputs.interface_temperature[l], solved.outputs.interface_temperature[l], 1e-8);
      ASSERT_NEAR(sleeper.outputs.shear_stress[l], solved.outputs.shear_stress[l], 1.0);
      ASSERT_NEAR(mine.shear_stress[l], theirs.shear_stress[l], 1.0);
      ASSERT_NEAR(sleeper.outputs.sliding_velocity[l], solved.outputs.sliding_velocity[l], 1e-6);
      ASSERT_NEAR(mine.sliding_velocity[l], theirs.sliding_velocity[l], 1e-6);
    }
  }
  EXPECT_GT(asleep, 300);
}

TEST(PhysicsHeatBasis, ModesAreTheStepsOfTheOperator) {
  for (const ModelOptions& options : {forced(), two_sided(forced(FarBoundary::kInsulated)), paper_options()}) {
    const HeatGrid grid = Rig(options).heat_grid();
    const HeatBasis basis(grid, options.soft, options.hard);
    const int n = grid.num_vertices();
    const HeatOperator heat(grid, options.soft, options.hard, 3e-9);
    std::vector<double> rows(static_cast<std::size_t>(n) * kLanes, 300.0);
    double flux[kLanes] = {1e10, 1e9};
    for (int m = 0; m < 30; ++m) {
      add_flux(heat, n, flux, rows.data());
      conduct(heat, n, rows.data(), rows.data());
    }
    std::vector<double> modes = rows, back = rows;
    const int live = to_modes(basis, 0, modes.data());
    to_profile(basis, live, 0, modes.data(), back.data());
    double there_and_back = 0.0, stepped = 0.0, held = 0.0, kept = 0.0;
    for (int i = 0; i < n; ++i)
      there_and_back = std::max(there_and_back, std::abs(back[i * kLanes] - rows[i * kLanes]));
    EXPECT_LT(there_and_back, 1e-9);
    const std::vector<double> decay = basis.decay(3e-9);
    for (int m = 0; m < 50; ++m) {
      double T0[kLanes];
      interface_later(basis, decay.data(), live, modes.data(), T0);
      decay_modes(decay.data(), live, n, modes.data(), modes.data());
      conduct(heat, n, rows.data(), rows.data());
      stepped = std::max(stepped, std::abs(T0[0] - rows[grid.interface * kLanes]));
    }
    EXPECT_LT(stepped, 1e-9);
    to_profile(basis, live, 0, modes.data(), back.data());
    for (int i = 0; i < n; ++i) {
      const double capacity = grid.capacity(i, options.soft, options.hard);
      held += capacity * (rows[i * kLanes] - 300.0);
      kept += capacity * (back[i * kLanes] - 300.0);
    }
    EXPECT_NEAR(kept / held, 1.0, 1e-9);
  }
}

}  // namespace
}  // namespace shearbus::testing
