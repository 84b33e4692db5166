// Friction that softens with the interface temperature, and the stress limit of the interface that results from
// friction and yield stress.
#include <gtest/gtest.h>

#include <cmath>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kP = 2e9;  // pressure [Pa]

InterfaceOptions softening_friction(double mu, double exponent) {
  InterfaceOptions options{mu, 1e12, FrictionLaws::place<ThermalSoftening>()};
  options.friction_reference_temperature = 300.0;
  options.friction_softening_exponent = exponent;
  return options;
}

TEST(PhysicsThermalSoftening, FallsFromMuAtTheReferenceToNothingAtMelting) {
  const Material soft = paper_options().soft;
  for (const double exponent : {1.0, 2.0, 4.5}) {
    const InterfaceOptions law = softening_friction(0.3, exponent);
    const auto mu = [&](double T) { return ThermalSoftening::at(law, soft, {1.0, T, 0.0}); };  // at P = 1 Pa
    EXPECT_EQ(mu(1.0).stress, 0.3);
    EXPECT_EQ(mu(300.0).stress, 0.3);
    EXPECT_EQ(mu(1220.0).stress, 0.0);
    EXPECT_EQ(mu(5000.0).stress, 0.0);
    EXPECT_NEAR(mu(760.0).stress, 0.3 * (1.0 - std::pow(0.5, exponent)), 1e-15);
    for (double T = 310.0; T < 1220.0; T += 37.0) {
      const double h = 1e-3;
      const double slope = (mu(T + h).stress - mu(T - h).stress) / (2.0 * h);
      EXPECT_NEAR(mu(T).slope, slope, 1e-6 * std::abs(slope) + 1e-12);
      EXPECT_LE(std::abs(mu(T).slope), ThermalSoftening::steepest(law, soft, {1.0, T, 0.0}, 300.0, T) * (1.0 + 1e-12));
      EXPECT_GE(std::abs(mu(T).slope),
                ThermalSoftening::steepest(law, soft, {1.0, T, 0.0}, T - 1.0, T) * (1.0 - 1e-12));
    }
  }
}

TEST(PhysicsThermalSoftening, ConstantsThatHaveNoMeaningAreRefused) {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.interface = softening_friction(0.3, 2.0);
  EXPECT_TRUE(refusals(options).empty());
  options.interface.friction_reference_temperature = 1220.0;
  ASSERT_EQ(refusals(options).size(), 1U);
  EXPECT_EQ(refusals(options)[0].key, "interface.friction_reference_temperature_k");
  options.interface = softening_friction(0.3, 0.9);
  ASSERT_EQ(refusals(options).size(), 1U);
  EXPECT_EQ(refusals(options)[0].key, "interface.friction_softening_exponent");
}

// The criterion of a unique answer is sufficient: wherever it holds, a fine scan must find that the balance H(a) =
// limit(T0(a)) - a falls strictly with the stress a.
TEST(PhysicsThermalSoftening, WhereTheCriterionHoldsTheBalanceFalls) {
  const Material soft = paper_options().soft;
  int unique = 0, several = 0;
  for (const double exponent : {1.0, 3.0})
    for (const double rise : {1e-9, 3e-9, 1e-8, 3e-8, 1e-7, 3e-7})
      for (const double T_ad : {300.0, 800.0, 1200.0})
        for (const double yield : {1e12, 0.4e9}) {
          InterfaceOptions law = softening_friction(0.3, exponent);
          law.yield_strength = yield;
          const StressLimit limit = interface_strength(law, soft, kP, nullptr);
          const FrictionHeating heating{T_ad, rise, 100.0, 2e-7};
          // Upper end of the scan [Pa]: at a larger stress there is no slip, or the stress exceeds the limit of the
          // unheated interface.
          const double a_max = std::min(heating.c / heating.b, limit.at(T_ad).stress);
          bool falls = true;
          double before = spare_strength(limit, heating, 0.0);
          for (int i = 1; i <= 20000; ++i) {
            const double now = spare_strength(limit, heating, a_max * i / 20000);
            falls = falls && now < before;
            before = now;
          }
          const bool promised = slip_is_unique(limit, heating, a_max);
          EXPECT_TRUE(!promised || falls) << exponent << " " << rise << " " << T_ad << " " << yield;
          (promised ? unique : several) += 1;
        }
  EXPECT_GT(unique, 10);
  EXPECT_GT(several, 5);
}

// The stress limit of the interface is the smaller of friction and yield stress; `is_coulomb` must be true if friction
// is the smaller.
TEST(PhysicsThermalSoftening, StrengthIsTheLesserOfBothBranchesAndSaysWhich) {
  const Material soft = paper_options().soft;
  InterfaceOptions law = softening_friction(0.3, 1.0);
  law.yield_strength = 0.5e9;
  const StressLimit limit = interface_strength(law, soft, kP, nullptr);
  int rubbing = 0, yielding = 0;
  for (double T = 300.0; T < 1220.0; T += 5.0) {
    const double friction = 0.3 * (1.0 - (T - 300.0) / 920.0) * kP;
    const double yield = 0.5e9 / kSqrt3 * softening(soft, kP, T).g;
    const StressLimit::Value value = limit.at(T);
    EXPECT_NEAR(value.stress, std::min(friction, yield), 1e-6 * yield);
    EXPECT_EQ(value.is_coulomb, friction < yield);
    (value.is_coulomb ? rubbing : yielding) += 1;
    EXPECT_LE(std::abs(value.slope), limit.steepest(300.0, T, 0.0) * (1.0 + 1e-9));
  }
  EXPECT_GT(rubbing, 10);
  EXPECT_GT(yielding, 10);
  EXPECT_EQ(limit.at(1220.0).stress, 0.0);
}

}  // namespace
}  // namespace shearbus::testing
