// Johnson and Cook's flow law: the printed formula, the inversion of the formula in the layer, and the constants that a
// scene must give.
#include "server/physics/material/flow_laws.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "server/physics/solver/flow/layer_flow.hpp"
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

// A layer of one cell at a uniform temperature. The tests compute the plastic strain increment of the layer under a
// stress and insert this increment into the flow law.
struct OneVertex {
  explicit OneVertex(const Material& material) : soft(material) {
    std::fill_n(T_ad, 2 * kLanes, 500.0);
    std::fill_n(response, 2, 1.0);
  }
  // Sets `dep` to the plastic strain increment of each lane under the stress `a` [Pa].
  void flow(const double (&a)[kLanes], double flux, double pressure, double dt, double (&dep)[kLanes]) {
    std::vector<double> rows(LayerFlow::size_of_rows(grid)), strain_new(2 * kLanes);
    sum.emplace(FlowProblem{&soft, &grid, response, T_ad, strain, dt}, rows.data());
    for (int l = 0; l < kLanes; ++l) sum->load(l, soft, pressure, a[l], a[l] > 0.0 ? flux / a[l] : 0.0);
    sum->sum(kAllLanes, strain_new.data());
    for (int l = 0; l < kLanes; ++l) dep[l] = sum->slip[l] / (grid.weight[0] + grid.weight[1]);
  }
  Material soft;
  Grid grid{GridOptions{1.0, 1, 1.0, FarBoundary::kInsulated}};
  double response[2];
  alignas(64) double T_ad[2 * kLanes] = {};
  alignas(64) double strain[2 * kLanes] = {};
  std::optional<LayerFlow> sum;
};

TEST(PhysicsJohnsonCook, TheFlowPutBackGivesTheStress) {
  Draw draw(3);
  double worst = 0.0, worst_slope = 0.0;
  int rated = 0, slow = 0, elastic = 0;
  for (int n = 0; n < 4000; ++n) {
    Material m = copper();
    m.rate_coefficient = draw.chance(0.2) ? 0.0 : draw.log_uniform(1e-4, 0.2);
    m.hardening_exponent = draw.log_uniform(0.02, 1.0);
    m.hardening_modulus = draw.log_uniform(1e6, 1e10);
    m.thermal_exponent = draw.log_uniform(0.4, 2.0);
    m.reference_strain_rate = draw.log_uniform(1e-3, 1e8);
    const double dt = draw.log_uniform(1e-12, 1e-6);
    OneVertex vertex(m);
    double a[kLanes], dep[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      vertex.strain[l] = vertex.strain[kLanes + l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(1e-12, 1e3);
      vertex.T_ad[l] = vertex.T_ad[kLanes + l] = draw.uniform(250.0, 1350.0);
      a[l] = flow_stress(m, vertex.strain[l], 0.0, vertex.T_ad[l]) / kSqrt3 * draw.log_uniform(0.8, 2.0);
    }
    vertex.flow(a, 0.0, 0.0, dt, dep);
    const LayerFlow sum = *vertex.sum;
    for (int l = 0; l < kLanes; ++l) {
      const double ep = vertex.strain[l], T = vertex.T_ad[l];
      if (dep[l] == 0.0) {
        ++elastic;
        ASSERT_LE(kSqrt3 * a[l], flow_stress(m, ep, 0.0, T) * (1 + 1e-13));
        continue;
      }
      (dep[l] > m.reference_strain_rate * dt ? rated : slow) += 1;
      if (dep[l] > 1e60) continue;
      // Relative change of the flow stress that an ulp of the plastic strain causes.
      const double ulp =
          4e-16 * (ep + dep[l]) * hardening_slope(m, ep, dep[l], dt, 0.0, T) / hardened_strength(m, ep, 0.0, 0.0, T);
      const double error = std::abs(flow_stress(m, ep + dep[l], 0.0, T, dep[l] / dt) / (kSqrt3 * a[l]) - 1.0);
      ASSERT_LT(error, 1e-13 + ulp) << "ep " << ep << " dep " << dep[l] << " n " << m.hardening_exponent << " C "
                                    << m.rate_coefficient;
      worst = std::max(worst, error);
      if (n % 10 != 0) continue;
      double more[kLanes], less[kLanes], dep_more[kLanes], dep_less[kLanes];
      const double step = 1e-6 * flow_exponent(m);
      for (int k = 0; k < kLanes; ++k) more[k] = a[k] * (1 + step), less[k] = a[k] * (1 - step);
      vertex.flow(more, 0.0, 0.0, dt, dep_more);
      vertex.flow(less, 0.0, 0.0, dt, dep_less);
      const bool kink = dep_less[l] == 0.0 ||
                        (dep_less[l] > m.reference_strain_rate * dt) != (dep_more[l] > m.reference_strain_rate * dt);
      if (kink || dep[l] < 1e-6 * ep) continue;
      const double slope = (dep_more[l] - dep_less[l]) / (2 * step);
      worst_slope = std::max(worst_slope, std::abs(sum.slope[l] / slope - 1.0));
    }
  }
  std::printf("%d rated, %d slow, %d elastic: worst stress %.1e, worst slope %.1e\n", rated, slow, elastic, worst,
              worst_slope);
  EXPECT_GT(std::min({rated, slow, elastic}), 1000);
  EXPECT_LT(worst_slope, 1e-3);
}

// The heat of the step softens the metal that flows. The slope of the plastic slip over the stress must include this
// softening.
TEST(PhysicsJohnsonCook, HeatingEntersTheSlope) {
  OneVertex vertex(copper());
  const double a0 = 150e6, heating = 2e-6;  // the stress a heats the metal by heating * a: 300 K at a0
  const auto slip = [&](double a) {
    double all[kLanes], dep[kLanes];
    std::fill_n(all, kLanes, a);
    vertex.flow(all, heating * a, 0.0, 1e-9, dep);
    return dep[3];
  };
  const double slope = (slip(a0 * (1 + 1e-6)) - slip(a0 * (1 - 1e-6))) / 2e-6;
  slip(a0);
  EXPECT_NEAR(vertex.sum->slope[3] / slope, 1.0, 1e-6);
}

TEST(PhysicsJohnsonCook, AMoltenVertexFlowsUnderAnyLoadAndNoneUnderNone) {
  OneVertex vertex(copper());
  std::fill_n(vertex.T_ad, kLanes, 1356.0);
  double a[kLanes] = {}, dep[kLanes];
  a[1] = 1e-3;
  vertex.flow(a, 0.0, 0.0, 1e-9, dep);
  EXPECT_EQ(vertex.sum->slip[0], 0.0);
  EXPECT_GT(vertex.sum->slip[1], 1e3);
  EXPECT_TRUE(std::isfinite(vertex.sum->slope[1]));
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
