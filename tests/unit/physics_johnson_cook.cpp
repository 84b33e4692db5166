// Johnson and Cook's flow law: the printed formula, the inversion of the formula in the layer, and the constants that a
// scene must give.
#include "server/physics/material/flow_laws.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

Material copper() {
  Material m = make_material("aluminium_dlp", {}).material;
  m.yield_strength = 90e6;
  m.hardening_exponent = 0.31;
  m.melting_temperature = 1356.0;
  follow_johnson_cook(m, 292e6, 0.025, 1.0, 1.09, 298.0);
  return m;
}

double printed(const Material& m, double ep, double rate, double T) {
  const double share =
      std::clamp((T - m.reference_temperature) / (m.melting_temperature - m.reference_temperature), 0.0, 1.0);
  return (m.yield_strength + m.hardening_modulus * std::pow(ep, m.hardening_exponent)) *
         (1.0 + m.rate_coefficient * std::log(std::max(rate / m.reference_strain_rate, 1.0))) *
         (1.0 - std::pow(share, m.thermal_exponent));
}

TEST(PhysicsJohnsonCook, IsThePrintedFormula) {
  const Material m = copper();
  for (double ep : {0.0, 1e-9, 1e-3, 0.3, 50.0}) {
    for (double rate : {0.0, 0.5, 1.0, 1e3, 1e8}) {
      for (double T : {1.0, 298.0, 298.0001, 700.0, 1350.0, 1356.0, 1e5}) {
        const double Y = printed(m, ep, rate, T);
        EXPECT_NEAR(flow_stress(m, ep, 11.2e9, T, rate), Y, 4e-15 * 1e9) << ep << " " << rate << " " << T;
      }
    }
  }
}

TEST(PhysicsJohnsonCook, SlopesAreItsDerivatives) {
  for (double exponent : {0.55, 1.0, 1.09, 1.68}) {
    Material m = copper();
    m.thermal_exponent = exponent;
    for (double T : {300.0, 500.0, 1000.0, 1350.0}) {
      const double dT = 1e-4 * std::min(T - 298.0, 1356.0 - T);
      const double slope = (softening(m, 0.0, T + dT).g - softening(m, 0.0, T - dT).g) / (2 * dT);
      EXPECT_NEAR(softening(m, 0.0, T).slope, slope, 1e-6 * std::abs(slope)) << T << " " << exponent;
    }
    const double dt = 1e-9;
    for (double ep : {0.0, 1e-3, 2.0}) {
      for (double dep : {1e-12, 1e-6, 1e-2}) {
        // next to the strain ep such a small increment is lost in the rounding of the finite differences
        if (dep < 1e-6 * ep) continue;
        const auto H = [&](double x) { return hardened_strength(m, ep + x, x / dt, 0.0, 300.0); };
        const double slope = (H(dep * 1.00001) - H(dep * 0.99999)) / (2e-5 * dep);
        EXPECT_NEAR(hardening_slope(m, ep, dep, dt, 0.0, 300.0), slope, 1e-4 * slope) << ep << " " << dep;
      }
    }
  }
}

TEST(PhysicsJohnsonCook, NoSlopeIsSteeperThanItsBound) {
  Draw draw(5);
  for (int n = 0; n < 2000; ++n) {
    Material m = draw.chance(0.5) ? copper() : make_material("aluminium_dlp", {}).material;
    m.thermal_exponent = draw.log_uniform(0.4, 2.0);
    const double cold = draw.uniform(250.0, 1200.0), hot = draw.uniform(cold, 1400.0);
    const double bound = FlowLaws::with(
        m.flow_law, [&](auto law) { return decltype(law)::type::steepest_softening(m, 5e9, cold, hot); });
    for (int i = 0; i <= 100; ++i) {
      const double T = cold + (hot - cold) * i / 100;
      ASSERT_LE(std::abs(softening(m, 5e9, T).slope), bound * (1 + 1e-12)) << T << " in " << cold << " to " << hot;
    }
  }
}

TEST(PhysicsJohnsonCook, AMoltenVertexFlowsUnderAnyLoadAndNoneUnderNone) {
  const Material m = copper();
  for (const double a : {1e-3, 0.0}) {
    const JohnsonCook law(m, 1e-9, {a, 1.0, m.melting_temperature});
    const VertexFlow flow = law.flow({.T = 1356.0, .rise = 0.0, .ep = 0.0, .wanted = true, .rest_is_known = false});
    EXPECT_EQ(flow.dep > 1e3, a > 0.0);
    EXPECT_EQ(flow.dep == 0.0, a == 0.0);
    EXPECT_TRUE(std::isfinite(flow.by_load));
  }
}

TEST(PhysicsJohnsonCook, ConstantsOfAnotherLawAreRefusedAndItsOwnAreNeeded) {
  using Given = std::vector<std::pair<std::string, double>>;
  const FlowLaw law = FlowLaws::place<JohnsonCook>();
  Given given{{"yield_strength_pa", 90e6},          {"hardening_modulus_pa", 292e6},
              {"hardening_exponent", 0.31},         {"rate_coefficient", 0.025},
              {"reference_strain_rate_per_s", 1.0}, {"thermal_softening_exponent", 1.09},
              {"reference_temperature_k", 298.0}};
  const MaterialResult made = make_material("steel_dlp", given, law);
  ASSERT_EQ(made.fault, "");
  EXPECT_EQ(made.material.flow_law, law);
  // constants_of() leaves out the strength constants of other laws. A material made from its list has the same ones.
  const auto constants = constants_of(made.material);
  EXPECT_TRUE(std::none_of(constants.begin(), constants.end(),
                           [](const auto& c) { return c.first == "hardening_coefficient"; }));
  EXPECT_EQ(constants_of(make_material("steel_dlp", constants, law).material), constants);

  // The yield strength of a catalog entry belongs to the flow law of that entry: a scene with another flow law must
  // give a yield strength.
  EXPECT_EQ(make_material("steel_dlp", Given(given.begin() + 1, given.end()), law).fault_field, "yield_strength_pa");
  EXPECT_EQ(make_material("steel_dlp", Given{{"hardening_modulus_pa", 1e8}}).fault_field, "hardening_modulus_pa");
  given.emplace_back("hardening_coefficient", 43);
  const MaterialResult mixed = make_material("steel_dlp", given, law);
  EXPECT_EQ(mixed.fault_field, "hardening_coefficient");
  EXPECT_NE(mixed.fault.find("johnson_cook"), std::string::npos);
  given.back() = {"melting_temperature_k", 298.0};
  EXPECT_EQ(make_material("steel_dlp", given, law).fault_field, "reference_temperature_k");
}

}  // namespace
}  // namespace shearbus::testing
