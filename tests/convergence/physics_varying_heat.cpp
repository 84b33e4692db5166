// Bodies whose k and c follow the temperature (server/physics/MODEL.md, "k(T) and c(T)"), against Kirchhoff's transform.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 1e9;
constexpr double kJump = 500.0;
constexpr double kStart = 300.0;

// Two equal bodies that rub under a constant stress at a constant jump: each takes half of the heat.
ModelOptions equal_bodies(double conductivity_slope, double heat_slope, FarBoundary far_boundary, int cells,
                          double grading) {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.interface = {0.05, 1e12};
  options.soft.melting_temperature = 1e5;
  options.soft.temperature_coefficient = 0.0;
  options.soft.conductivity_slope = conductivity_slope;
  options.soft.specific_heat_slope = heat_slope;
  options.hard = options.soft;
  options.grid.cells = cells;
  options.grid.grading = grading;
  options.grid.far_boundary = far_boundary;
  options.hard_grid = options.grid;
  return options;
}
double flux_of_body(double jump) {
  return 0.5 * 0.05 * kPressure * jump;
}

double T0_after(const ModelOptions& options, double t, int steps, double jump = kJump) {
  Rig rig(options, 1);
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
  rig.set_all(jump, kPressure);
  for (int n = 0; n < steps; ++n) rig.step(t / steps);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kCoulomb);
  return rig.T(0);
}

// The temperature at which the integral of k from the start is `sum`.
double temperature_of(const Material& m, double sum) {
  const double a = m.conductivity_slope, x = sum / m.conductivity;  // of (T - 300) + a (T - 300)^2 / 2
  return kStart + (std::sqrt(1.0 + 2.0 * a * x) - 1.0) / a;
}

// If k and c change by the same factor the diffusivity is constant, and the integral of k follows the linear equation.
TEST(PhysicsVaryingHeat, HalfSpacesUnderAConstantFluxFollowKirchhoffsTransform) {
  for (const double slope : {1e-3, -4e-4}) {
    const auto options = [&](TimeIntegrator integrator) {
      ModelOptions made = equal_bodies(slope, slope, FarBoundary::kHalfSpace, 600, 1.01);
      made.time_integrator = integrator;
      return made;
    };
    const Material m = options(TimeIntegrator::kBackwardEuler).soft;
    const double t = 100e-9;
    const double exact = temperature_of(m, 2.0 * flux_of_body(kJump) * std::sqrt(m.diffusivity * t / std::numbers::pi));
    const double linear =
        kStart + 2.0 * flux_of_body(kJump) / m.conductivity * std::sqrt(m.diffusivity * t / std::numbers::pi);
    EXPECT_GT(std::abs(exact - linear), 0.05 * (exact - kStart));
    for (const TimeIntegrator integrator : {TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2}) {
      const double least = integrator == TimeIntegrator::kSdirk2 ? 1.2 : 0.9;  // friction starts suddenly
      std::printf("a = %g/K, T0 to %.0f K (constant k and c: %.0f K)\n", slope, exact, linear);
      Orders orders("steps: T0 [K]", least, 0.0, Orders::kMore);
      for (const int steps : {16, 32, 64}) orders.add(steps, std::abs(T0_after(options(integrator), t, steps) - exact));
      EXPECT_LT(orders.last(), 2.5e-3 * (exact - kStart));
    }
  }
}

// Between held faces the flux becomes steady: the integral of k from the face to z = 0 is q h, whatever c is.
TEST(PhysicsVaryingHeat, ASteadyFluxBetweenHeldFacesIsExact) {
  const ModelOptions options = equal_bodies(-6e-4, 1e-3, FarBoundary::kIsothermal, 40, 1.05);
  constexpr double kSlow = 100.0;
  const double exact = temperature_of(options.soft, flux_of_body(kSlow) * options.grid.thickness);
  EXPECT_GT(exact, 800.0);
  EXPECT_NEAR(T0_after(options, 400e-6, 400, kSlow), exact, 1e-8 * exact);
}

// ---- Tables ----

// k or c of both bodies with two kinks, over its value at 300 K.
const HeatTable kKinked{{300.0, 450.0, 700.0, 1e5}, {1.0, 0.7, 1.6, 1.6}};

ModelOptions with_tables(ModelOptions options, const HeatTable& conductivity, const HeatTable& heat) {
  options.heat_tables = std::make_shared<const HeatTables>(HeatTables{conductivity, heat, conductivity, heat});
  return options;
}

// The temperature at which the integral of kKinked from 300 K is `sum`: Kirchhoff's transform, quadratic between rows.
double kinked_temperature_of(double sum) {
  for (std::size_t i = 1;; ++i) {
    const double T = kKinked.temperature[i - 1], width = kKinked.temperature[i] - T, first = kKinked.share[i - 1];
    const double slope = (kKinked.share[i] - first) / width, whole = 0.5 * width * (first + kKinked.share[i]);
    if (sum <= whole) return T + 2.0 * sum / (first + std::sqrt(first * first + 2.0 * slope * sum));
    sum -= whole;
  }
}

TEST(PhysicsHeatTables, HalfSpacesUnderAConstantFluxFollowKirchhoffsTransform) {
  const ModelOptions options =
      with_tables(equal_bodies(kNotGiven, kNotGiven, FarBoundary::kHalfSpace, 600, 1.01), kKinked, kKinked);
  const Material& m = options.soft;
  const double t = 400e-9;
  const double linear = 2.0 * flux_of_body(kJump) / m.conductivity * std::sqrt(m.diffusivity * t / std::numbers::pi);
  const double exact = kinked_temperature_of(linear);
  EXPECT_GT(exact, 700.0);  // beyond both kinks
  EXPECT_GT(std::abs(exact - kStart - linear), 0.05 * linear);
  std::printf("tables, T0 to %.1f K (constant k and c: %.1f K)\n", exact, kStart + linear);
  Orders orders("steps: T0 [K]", 0.85, 0.0, Orders::kMore);
  for (const int steps : {16, 32, 64}) orders.add(steps, std::abs(T0_after(options, t, steps) - exact));
  EXPECT_LT(orders.last(), 4e-3 * (exact - kStart));
}

TEST(PhysicsHeatTables, ASteadyFluxBetweenHeldFacesIsExact) {
  const ModelOptions options = with_tables(equal_bodies(kNotGiven, kNotGiven, FarBoundary::kIsothermal, 40, 1.05),
                                           kKinked, {{0.0, 500.0, 1e5}, {1.0, 1.5, 2.0}});
  constexpr double kSlow = 100.0;
  const double exact = kinked_temperature_of(flux_of_body(kSlow) * options.grid.thickness / options.soft.conductivity);
  EXPECT_GT(exact, 650.0);
  EXPECT_NEAR(T0_after(options, 400e-6, 400, kSlow), exact, 1e-8 * exact);
}

// A table along a straight line is a slope.
TEST(PhysicsHeatTables, AStraightTableIsASlope) {
  const auto line = [](double slope) {
    HeatTable table{{50.0, 320.0, 410.0, 600.0, 2000.0}, {}};
    for (const double T : table.temperature) table.share.push_back(1.0 + slope * (T - 300.0));
    table.temperature.push_back(1e5);  // to melting, which is not reached
    table.share.push_back(table.share.back());
    return table;
  };
  Rig slopes(equal_bodies(-2e-4, 5e-4, FarBoundary::kInsulated, 20, 1.1), 1);
  Rig tables(with_tables(equal_bodies(kNotGiven, kNotGiven, FarBoundary::kInsulated, 20, 1.1), line(-2e-4), line(5e-4)),
             1);
  for (int n = 0; n < 50; ++n) {
    for (Rig* rig : {&slopes, &tables}) {
      rig->inputs.mass_soft[0] = rig->inputs.mass_hard[0] = 1e12;
      rig->set_all(kJump, kPressure);
      rig->step(2e-9);
    }
    ASSERT_NEAR(tables.T(0), slopes.T(0), 1e-10 * slopes.T(0)) << n;
  }
  EXPECT_GT(slopes.T(0), 500.0);
}

// A body stores what enters, as the integral of c(T): of a slope, and of a table with kinks.
TEST(PhysicsVaryingHeat, TheHeatThatEntersIsTheGrowthOfTheEnthalpy) {
  const ModelOptions by_slopes = equal_bodies(-4e-4, 1e-3, FarBoundary::kInsulated, 60, 1.08);
  const ModelOptions by_tables =
      with_tables(equal_bodies(kNotGiven, kNotGiven, FarBoundary::kInsulated, 60, 1.08), kKinked, kKinked);
  for (const ModelOptions& options : {by_slopes, by_tables}) {
    Rig rig(options, 1);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
    rig.set_all(kJump, kPressure);
    TileLedger ledger;
    double entered = 0.0, left = 0.0;
    for (int n = 0; n < 200; ++n) {
      rig.step(1e-9);
      rig.model.record_energy(*rig.operators, rig.inputs, rig.outputs, rig.trial.data(), rig.committed.data(), ledger);
      entered += rig.outputs.friction_heat[0];
      left += ledger(LedgerTerm::kHeatResidual, 0);
    }
    EXPECT_GT(rig.T(0), 600.0);
    std::printf("heat of 200 steps that is missing: %.1e of it\n", left / entered);
    EXPECT_LT(std::abs(left), 1e-8 * entered);
    EXPECT_NEAR(rig.stored_heat(kStart), entered, 1e-8 * entered);
  }
}

// A slope of 0 is a body of constant k and c, to the last bit.
TEST(PhysicsVaryingHeat, ASlopeOfZeroChangesNoBit) {
  Rig with(equal_bodies(0.0, 0.0, FarBoundary::kInsulated, 20, 1.1), 1);
  Rig without(equal_bodies(kNotGiven, kNotGiven, FarBoundary::kInsulated, 20, 1.1), 1);
  for (Rig* rig : {&with, &without}) {
    rig->set_all(kJump, kPressure);
    for (int n = 0; n < 5; ++n) rig->step(1e-9);
  }
  EXPECT_EQ(with.committed, without.committed);
}

}  // namespace
}  // namespace shearbus::testing
