// Preston, Tonks and Wallace's flow law: the printed formula and its limits, monotony, and the inversion of the formula
// in the layer.
#include "server/physics/material/flow_laws.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "server/physics/solver/velocity_driven/waves_return.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr double kMelting = 1357.0;

Material metal_of(const Material& law) {
  Material m;
  m.density = 8930.0;
  m.shear_modulus = 51.8e9;
  m.melting_temperature = kMelting;
  adopt_flow_law(m, law);
  return m;
}

Material copper_like() {
  return metal_of(preston_tonks_wallace_constants());
}

// The flow of a vertex of strain `ep` under the shear stress a, which has heated it by `rise` to T.
VertexFlow flow_under(const Material& m, double dt, double a, double P, double T, double ep, double rise = 0.0) {
  const PrestonTonksWallace law(m, dt, {a, 1.0 + m.pressure_coefficient * P, m.melting_temperature});
  return law.flow({.T = T, .rise = rise, .ep = ep, .wanted = true, .rest_is_known = false});
}

double attempt_rate(const Material& m, double T) {
  const double G = m.shear_modulus * (1 - m.modulus_temperature * T / m.melting_temperature);
  const double xi =
      0.5 * std::cbrt(4 * M_PI * m.density * 6.02214076e23 / (3 * m.molar_mass)) * std::sqrt(G / m.density);
  return m.attempt_rate * xi;
}

double two_G(const Material& m, double T) {
  return 2 * m.shear_modulus * (1 - m.modulus_temperature * T / m.melting_temperature) *
         std::exp(-0.001 * T / (m.melting_temperature - T));
}

// Flow stresses of OFHC copper from the tests of the code impala (Los Alamos), each with the relative tolerance used
// there. The hydrocode FLAG compressed single cells from 298 K, with constant G = 45.78 GPa and T_melt = 1625 K. At
// rates above 1 1/s plastic work heats the cells, with the specific heat c = 383 J/(kg K).
TEST(PhysicsPrestonTonksWallace, CopperIsAsStrongAsInAnotherCode) {
  Material m = make_material("copper_ofhc_ptw", {}).material;
  m.density = 8937.5;
  m.shear_modulus = 45.78e9;
  m.modulus_temperature = 0.0;
  m.melting_temperature = 1625.0;
  const double heat = 3.83e2 * m.density;  // heat capacity per volume [J/(m3 K)]
  struct Point {
    double rate, strain, stress, share;
    bool adiabatic;
  };
  for (const Point& at : {Point{1.0, 0.371143, 385.751e6, 0.09, false}, Point{1e2, 0.388339, 418.512e6, 0.11, true},
                          Point{1e4, 0.382749, 458.198e6, 0.09, true}, Point{1e6, 0.244376, 521.416e6, 0.01, true}}) {
    double T = 298.0;
    constexpr int kSteps = 1000;
    for (int i = 0; i < kSteps && at.adiabatic; ++i) {
      const double strain = at.strain * (i + 0.5) / kSteps;
      T += flow_stress(m, strain, 0.0, T, at.rate) * at.strain / kSteps / heat;
    }
    EXPECT_NEAR(flow_stress(m, at.strain, 0.0, T, at.rate) / at.stress, 1.0, at.share)
        << at.rate << " at " << T << " K";
  }
}

// The yield stress tau_y and the saturation stress tau_s by the formulas of Preston, Tonks and Wallace, divided by the
// shear modulus.
struct Branches {
  double yield, saturation;
};
Branches branches(const Material& m, double rate, double T) {
  const double r = rate / attempt_rate(m, T);
  const double erf = std::erf(m.activation * T / m.melting_temperature * std::max(0.0, std::log(1 / r)));
  const double shock = m.saturation_cold * std::pow(r, m.overdriven_exponent);
  const double medium = m.medium_rate_yield * std::pow(r, m.medium_rate_exponent);
  return {std::max(m.yield_cold - (m.yield_cold - m.yield_hot) * erf, std::min(medium, shock)),
          std::max(m.saturation_cold - (m.saturation_cold - m.saturation_hot) * erf, shock)};
}

TEST(PhysicsPrestonTonksWallace, BeginsAtTheYieldStressAndEndsAtSaturation) {
  const Material m = copper_like();
  for (double rate : {1.0, 1e3, 1e5, 1e6, 1e7}) {
    for (double T : {10.0, 300.0, 800.0, 1300.0}) {
      const Branches at = branches(m, rate, T);
      EXPECT_NEAR(flow_stress(m, 0.0, 0.0, T, rate) / (two_G(m, T) * at.yield), 1.0, 1e-7) << rate << " " << T;
      EXPECT_NEAR(flow_stress(m, 1e4, 0.0, T, rate) / (two_G(m, T) * at.saturation), 1.0, 1e-7) << rate << " " << T;
    }
  }
}

// The differential equation of hardening, which Preston, Tonks and Wallace give before its integrated form:
//   dtau/dep = theta (exp(p (tau_s - tau)/d) - 1) / (exp(p (tau_s - tau_y)/d) - 1),  d = s_0 - tau_y
// where theta, p and s_0 are constants of the law.
TEST(PhysicsPrestonTonksWallace, HardeningObeysItsDifferentialEquation) {
  for (double p : {0.0, 0.5, 2.0, 8.0}) {
    Material m = copper_like();
    m.work_hardening_curvature = p;
    for (double rate : {1.0, 1e4, 1e6}) {
      const double T = 500.0, per_tau = two_G(m, T), h = 1e-6;
      const Branches at = branches(m, rate, T);
      for (double ep : {1e-4, 0.01, 0.1, 0.5}) {
        const double tau = flow_stress(m, ep, 0.0, T, rate) / per_tau;
        const double slope =
            (flow_stress(m, ep + h, 0.0, T, rate) - flow_stress(m, ep - h, 0.0, T, rate)) / (2 * h * per_tau);
        const double w = p / (m.saturation_cold - at.yield);
        const double share = p == 0.0
                                 ? (at.saturation - tau) / (at.saturation - at.yield)
                                 : std::expm1(w * (at.saturation - tau)) / std::expm1(w * (at.saturation - at.yield));
        EXPECT_NEAR(slope / (m.work_hardening_rate * share), 1.0, 2e-5) << p << " " << rate << " " << ep;
      }
    }
  }
}

// Above the attempt rate the flow stress is the power law of overdriven shocks and does not depend on the strain. At
// the attempt rate this branch joins the branch of thermal glide without a jump.
TEST(PhysicsPrestonTonksWallace, TheOverdrivenBranchIsAPowerOfTheRateAndJoinsContinuously) {
  const Material m = copper_like();
  for (double T : {10.0, 300.0, 1200.0}) {
    const double attempts = attempt_rate(m, T);
    for (double over : {1.0, 2.0, 1e2, 1e4}) {
      const double expected = two_G(m, T) * m.saturation_cold * std::pow(over, m.overdriven_exponent);
      EXPECT_NEAR(flow_stress(m, 0.0, 0.0, T, attempts * over) / expected, 1.0, 1e-12);
      EXPECT_NEAR(flow_stress(m, 3.0, 0.0, T, attempts * over) / expected, 1.0, 1e-12);
    }
    for (double ep : {0.0, 0.1, 10.0}) {
      const double below = flow_stress(m, ep, 0.0, T, attempts * (1 - 1e-9));
      EXPECT_NEAR(below / flow_stress(m, ep, 0.0, T, attempts * (1 + 1e-9)), 1.0, 1e-8) << T << " " << ep;
    }
  }
}

// A search brackets the answer of a step. The bracket is valid only if the flow stress never falls as the strain or the
// rate grows, and never rises with the temperature.
TEST(PhysicsPrestonTonksWallace, RisesWithStrainAndRateAndFallsWithTemperature) {
  Draw draw(32);
  constexpr double kRounding = 1e-13;
  for (int i = 0; i < 400; ++i) {
    Material law = random_preston_tonks_wallace(draw);
    if (i % 2 == 0) law.activation = 1.0;  // the largest value that fault_of allows
    if (i % 3 == 0) law.modulus_temperature = 0.6;
    if (i % 5 == 0) law.medium_rate_exponent = 1.0;
    const Material m = metal_of(law);
    ASSERT_EQ(PrestonTonksWallace::fault_of(m).field, "");
    const double P = draw.chance(0.5) ? 0.0 : draw.uniform(0.0, 30e9);
    const double ep = draw.chance(0.3) ? 0.0 : draw.log_uniform(1e-6, 100.0), T = draw.uniform(1.0, kMelting - 1.0);
    const double rate = draw.log_uniform(1e-4, 1e13);
    double before = 0.0;
    for (double r = 1e-4; r < 1e14; r *= 1.3) {
      const double Y = flow_stress(m, ep, P, T, r);
      ASSERT_GE(Y, before * (1 - kRounding)) << "rate " << r;
      before = Y;
    }
    before = 0.0;
    for (double e = 1e-8; e < 1e3; e *= 1.3) {
      const double Y = flow_stress(m, e, P, T, rate);
      ASSERT_GE(Y, before * (1 - kRounding)) << "strain " << e;
      before = Y;
    }
    before = 1e300;
    for (double temperature = 1.0; temperature <= kMelting; temperature += 3.39) {
      const double Y = flow_stress(m, ep, P, temperature, rate);
      ASSERT_LE(Y, before * (1 + kRounding)) << "temperature " << temperature;
      before = Y;
    }
    EXPECT_EQ(flow_stress(m, ep, P, kMelting, rate), 0.0);
  }
}

TEST(PhysicsPrestonTonksWallace, SlopesAreItsDerivatives) {
  Draw draw(33);
  for (int i = 0; i < 500; ++i) {
    const Material m = metal_of(random_preston_tonks_wallace(draw));
    const double T = draw.uniform(100.0, 1300.0), dT = 1e-3, P = draw.uniform(0.0, 20e9);
    const double g_slope = (softening(m, P, T + dT).g - softening(m, P, T - dT).g) / (2 * dT);
    EXPECT_NEAR(softening(m, P, T).slope, g_slope, 1e-6 * std::abs(g_slope));
    const double dt = 1e-9, ep = draw.log_uniform(1e-3, 1.0), dep = draw.log_uniform(1e-7, 1e-2);
    const auto H = [&](double x) { return hardened_strength(m, ep + x, x / dt, P, T); };
    const double h = 1e-5 * dep, slope = hardening_slope(m, ep, dep, dt, P, T);
    // Where the law changes its branch, its left and right slopes differ, and any value between them is accepted.
    const double left = (H(dep) - H(dep - h)) / h, right = (H(dep + h) - H(dep)) / h;
    EXPECT_GE(slope, std::min(left, right) - 1e-4 * slope - 1e-15 * H(dep) / h) << i;
    EXPECT_LE(slope, std::max(left, right) + 1e-4 * slope + 1e-15 * H(dep) / h) << i;
  }
}

TEST(PhysicsPrestonTonksWallace, NoSlopeIsSteeperThanItsBound) {
  Draw draw(34);
  for (int i = 0; i < 1000; ++i) {
    const Material m = metal_of(random_preston_tonks_wallace(draw));
    const double cold = draw.uniform(1.0, 1400.0), hot = cold + draw.log_uniform(1e-3, 400.0);
    const double bound = PrestonTonksWallace::steepest_softening(m, 5e9, cold, hot);
    for (int k = 0; k <= 20; ++k) {
      const double T = cold + (hot - cold) * k / 20;
      ASSERT_LE(std::abs(softening(m, 5e9, T).slope), bound * (1 + 1e-12)) << T << " in " << cold << " to " << hot;
    }
  }
}

// The flow finds the strain increment for a stress. The flow stress at this increment must be the same stress.
TEST(PhysicsPrestonTonksWallace, TheFlowPutBackGivesTheStress) {
  Draw draw(35);
  int flowed = 0, overdriven = 0, crept = 0;
  for (int i = 0; i < 20000; ++i) {
    const Material m = metal_of(random_preston_tonks_wallace(draw));
    const double dt = draw.log_uniform(1e-12, 1e-5), T = draw.uniform(1.0, 1356.9), P = draw.uniform(0.0, 30e9);
    const bool slow = draw.chance(0.1);  // a load so small that the flow is very slow
    const double ep = slow || draw.chance(0.2) ? 0.0 : draw.log_uniform(1e-8, 1e3);
    const double Y_rest = flow_stress(m, ep, P, T);
    const double share = draw.chance(0.3) ? draw.uniform(0.9, 1.1) : draw.log_uniform(0.5, 100.0);
    const double Y = slow ? flow_stress(m, 1e-3 * dt * draw.uniform(0.0, 1.0), P, T) : Y_rest * share;
    const double a = Y / kSqrt3;
    const VertexFlow flow = flow_under(m, dt, a, P, T, ep);
    const double dep = flow.dep, slope = flow.by_load;
    ASSERT_TRUE(std::isfinite(dep) && std::isfinite(slope) && dep >= 0.0 && slope >= 0.0) << dep << " " << slope;
    if (kSqrt3 * a <= Y_rest * (1 - 1e-13)) {
      ASSERT_EQ(dep, 0.0);
    }
    if (dep == 0.0) {
      ASSERT_LE(kSqrt3 * a, Y_rest * (1 + 1e-12));
      continue;
    }
    ++flowed;
    overdriven += dep / dt > attempt_rate(m, 0.0);
    crept += dep < 1e-3 * dt;
    const double back = flow_stress(m, ep + dep, P, T, dep / dt);
    const double ulp =
        4e-16 * (ep + dep) * hardening_slope(m, ep, dep, dt, P, T) / hardened_strength(m, ep + dep, dep / dt, P, T);
    // An error 1e-15 of erf is an error 1e-15 of a cold stress, and a larger relative error of the lower hot stress.
    const double erf = 2e-15 * std::max(m.yield_cold / m.yield_hot, m.saturation_cold / m.saturation_hot);
    ASSERT_NEAR(back / (kSqrt3 * a), 1.0, 1e-13 + ulp + erf) << i << ": dep " << dep << ", ep " << ep << ", T " << T;
  }
  EXPECT_GT(flowed, 10000);
  EXPECT_GT(overdriven, 1000);
  EXPECT_GT(crept, 10);
}

TEST(PhysicsPrestonTonksWallace, AMoltenVertexFlowsUnderAnyLoadAndNoneUnderNone) {
  const Material m = copper_like();
  EXPECT_EQ(softening(m, 0.0, kMelting).g, 0.0);
  for (double a : {1e-290, 1e6, 1e20, 0.0}) {
    const VertexFlow flow = flow_under(m, 1e-9, a, 0.0, kMelting + 1.0, 0.1);
    EXPECT_EQ(flow.dep > 1e50, a > 0.0);
    EXPECT_TRUE(std::isfinite(flow.dep) && std::isfinite(flow.by_load));
    if (a == 0.0) {
      EXPECT_EQ(flow.dep, 0.0);
    }
  }
}

TEST(PhysicsPrestonTonksWallace, ConstantsOutOfOrderAreRefused) {
  const auto fault_with = [](double Material::*constant, double value) {
    Material m = copper_like();
    m.*constant = value;
    return PrestonTonksWallace::fault_of(m).field;
  };
  EXPECT_EQ(PrestonTonksWallace::fault_of(copper_like()).field, "");
  EXPECT_EQ(fault_with(&Material::saturation_hot, 0.01), "saturation_stress_hot");
  EXPECT_EQ(fault_with(&Material::yield_hot, 3e-4), "yield_stress_hot");
  EXPECT_EQ(fault_with(&Material::yield_cold, 0.02), "yield_stress_cold");
  EXPECT_EQ(fault_with(&Material::medium_rate_yield, 0.001), "medium_rate_yield_coefficient");
  EXPECT_EQ(fault_with(&Material::medium_rate_exponent, 0.2), "medium_rate_yield_exponent");
  EXPECT_EQ(fault_with(&Material::activation, 1.5), "activation_coefficient");
  EXPECT_EQ(fault_with(&Material::modulus_temperature, 0.7), "modulus_temperature_coefficient");
  EXPECT_EQ(fault_with(&Material::work_hardening_curvature, 200.0), "work_hardening_curvature");
  EXPECT_EQ(fault_with(&Material::attempt_rate, 1e-20), "attempt_rate_coefficient");
}

// The return of a trial stress to the flow stress, as a layer with inertia makes it: where nearly all of the trial stress
// flows away next to melting, the stress and the temperature that it causes belong together to the last digits.
TEST(PhysicsPrestonTonksWallace, AReturnWithItsOwnHeatIsTheFlowStressAtThatHeat) {
  Draw draw(4711);
  double worst = 0.0;
  int hot = 0;
  for (int n = 0; n < 2000; ++n) {
    ModelOptions options = paper_options();
    adopt_flow_law(options.soft, random_preston_tonks_wallace(draw));
    const Material& soft = options.soft;
    const double dt = draw.log_uniform(1e-10, 1e-7), P = draw.uniform(0.0, 2e10), ep = draw.log_uniform(1e-3, 1.0);
    const double T_ad = draw.uniform(300.0, 1000.0), trial = draw.log_uniform(1e8, 1e12);
    // Half of the returns would melt the vertex if they carried 10 GPa or less.
    const double rise = draw.chance(0.5) ? 0.0 : (soft.melting_temperature - T_ad) / draw.log_uniform(1e7, 1e10);
    const ReturnedStress found = LawReturn(soft, P, dt).at(ep, trial, T_ad, rise);
    const double dep = (trial - found.stress) / (kSqrt3 * soft.shear_modulus), T = T_ad + rise * found.stress;
    if (dep < 1e-6) continue;  // mostly elastic: the strain is the unknown, not the stress
    ASSERT_LT(T, soft.melting_temperature);
    const double carried = flow_stress(soft, ep + dep, P, T, dep / dt) / kSqrt3;
    worst = std::max(worst, std::abs(found.stress / carried - 1.0));
    ASSERT_NEAR(found.stress, carried, 1e-10 * carried) << "trial " << trial << " T " << T << " dep " << dep;
    hot += T > 0.99 * soft.melting_temperature;
  }
  std::printf("worst %.1e, %d near melting\n", worst, hot);
  EXPECT_GT(hot, 100);
}

}  // namespace
}  // namespace shearbus::testing
