// The Coulomb-Tresca law of the hydrocode, DLP (5), at one interface node and between two plates.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "hydro_stub/coulomb_tresca_law.hpp"
#include "hydro_stub/shear_column.hpp"
#include "proto/scene/rules.hpp"
#include "server/physics/material/strength.hpp"
#include "tests/support/hydro_laws.hpp"

namespace shearbus {
namespace {

using hydro::ShearColumn;

physics::InterfaceOptions friction_of(double at_rest, double fast) {
  return {.friction_coefficient = at_rest,
          .friction_law = physics::FrictionLaws::place<physics::VelocityWeakening>(),
          .friction_coefficient_fast = fast,
          .velocity_decay = 0.01};
}
double coefficient(double at_rest, double fast, double velocity) {
  return fast + (at_rest - fast) * std::exp(-0.01 * std::max(0.0, velocity));
}

physics::Material catalog_material(const char* name) {
  return physics::make_material(name, {}).material;
}

TEST(CoulombTresca, SlidesInTheStateThatSlipsMost) {
  std::mt19937_64 random(7);
  const physics::InterfaceOptions paper = friction_of(0.3, 0.02);
  const physics::Material soft = catalog_material("aluminium_dlp");
  int several = 0;
  for (int draw = 0; draw < 2000; ++draw) {
    const double pressure = std::pow(10.0, std::uniform_real_distribution(7.0, 11.0)(random));
    const double velocity = std::uniform_real_distribution(0.1, 500.0)(random);
    const double compliance = std::pow(10.0, std::uniform_real_distribution(-8.0, -6.0)(random));
    const double found = physics::sliding_stress(paper, soft, pressure, velocity, compliance);
    const auto residual = [&](double s) { return coefficient(0.3, 0.02, velocity - compliance * s) * pressure - s; };
    ASSERT_LT(std::abs(residual(found)), 1e-11 * pressure) << draw;
    // The stress found is the smallest root of mu(v) P - s = 0, hence the state with the most slip: for all smaller
    // stresses the residual is positive.
    int changes = 0;
    for (int k = 0; k < 500; ++k) ASSERT_GT(residual(found * (k + 0.5) / 500.5), 0.0) << draw;
    for (int k = 1; k <= 500; ++k) {
      const double reach = 1.2 * std::max(velocity / compliance, 0.3 * pressure);
      changes += (residual(reach * k / 500) > 0.0) != (residual(reach * (k - 1) / 500) > 0.0) ? 1 : 0;
    }
    several += changes > 1 ? 1 : 0;
  }
  EXPECT_GT(several, 20) << "the draws hold cases with several states";
}

TEST(CoulombTresca, FrictionThatRisesWithVelocityHasItsRootToo) {
  const double found =
      physics::sliding_stress(friction_of(0.1, 0.4), catalog_material("aluminium_dlp"), 1e9, 100.0, 1.5e-7);
  EXPECT_NEAR(found, coefficient(0.1, 0.4, 100.0 - 1.5e-7 * found) * 1e9, 1e-3);
}

struct Plates {
  explicit Plates(std::vector<double> jumps, double pressure, guest::FarEnd end)
      : problem(test::aluminium_on_steel(std::move(jumps), 100)),
        soft(catalog_material("aluminium_dlp")),
        hard(catalog_material("steel_dlp")) {
    problem.soft.far_end = problem.hard.far_end = end;
    problem.pressure = hydro::PressureHistory{{}, std::vector<double>(problem.columns, pressure)};
  }
  hydro::CoulombTrescaLaw law() const {
    guest::CoulombTresca constants;
    scene::fill_defaults(constants);
    return {constants, soft, hard, problem.initial_temperature};
  }

  hydro::ColumnProblem problem;
  physics::Material soft, hard;
};

TEST(CoulombTresca, StressIsAtTheLimitWhereItSlipsAndBelowWhereItSticks) {
  for (const double pressure : {0.05e9, 0.4e9, 3e9, 11.2e9}) {
    const Plates plates({2.0, 10.0, 28.0, 60.0, -150.0, 400.0}, pressure, guest::FAR_END_FREE);
    ShearColumn column(plates.problem);
    hydro::CoulombTrescaLaw law = plates.law();
    std::vector<double> temperature = plates.problem.initial_temperature;  // T0 before the step [K]
    int slips = 0;
    for (int step = 0; step < 1500; ++step) {
      column.advance(law);
      const auto& answer = column.answer();
      for (std::size_t i = 0; i < 6; ++i) {
        const double s = answer.shear_stress[i];
        const double v = answer.sliding_velocity[i];
        const double yield = physics::flow_stress(plates.soft, 0.0, pressure, temperature[i]) / std::numbers::sqrt3;
        const double limit = std::min(coefficient(0.3, 0.02, std::abs(v)) * pressure, yield);
        if (answer.velocity_jump_new[i] != 0.0) {
          ++slips;
          ASSERT_NEAR(std::abs(s), limit, 1e-9 * limit) << "step " << step << " column " << i << " at " << pressure;
          ASSERT_GE(s * answer.velocity_jump_new[i], 0.0);
        } else {
          ASSERT_LE(std::abs(s), std::min(0.3 * pressure, yield) * (1 + 1e-12));
        }
        temperature[i] = answer.interface_temperature[i];
      }
    }
    EXPECT_GT(slips, 100);
  }
}

TEST(CoulombTresca, AJumpThatIsStoppedDoesNotRing) {
  const Plates plates({5.0, 28.0, 45.0, 60.0, 90.0}, 11.2e9, guest::FAR_END_FREE);
  ShearColumn column(plates.problem);
  hydro::CoulombTrescaLaw law = plates.law();
  std::vector<int> stopped(5, 0), reversals(5, 0);
  std::vector<double> previous(5, 0.0);
  for (int step = 0; step < 4000; ++step) {
    column.advance(law);
    for (std::size_t i = 0; i < 5; ++i) {
      const double jump = column.soft().velocity_at(0)[i] - column.hard().velocity_at(0)[i];
      stopped[i] += jump == 0.0 ? 1 : 0;
      reversals[i] += jump * previous[i] < 0.0 ? 1 : 0;
      previous[i] = jump;
    }
  }
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_GT(stopped[i], 1000) << "column " << i << " comes to rest";
    EXPECT_EQ(reversals[i], 0) << "column " << i << " never jumps from one direction to the other in a step";
  }
}

TEST(CoulombTresca, LedgersCloseAndTheZoneHoldsItsShareOfTheHeat) {
  const Plates plates({100.0, 250.0}, 11.2e9, guest::FAR_END_TRANSMITTING);
  ShearColumn column(plates.problem);
  hydro::CoulombTrescaLaw law = plates.law();
  std::vector<double> heat(2, 0.0);
  for (int step = 0; step < 1000; ++step) {
    column.advance(law);
    for (std::size_t i = 0; i < 2; ++i) heat[i] += column.answer().friction_heat[i];
  }
  const double capacity = plates.soft.conductivity / plates.soft.diffusivity * plates.problem.soft.zone_width;
  for (std::size_t i = 0; i < 2; ++i) {
    const ShearColumn::Ledger ledger = column.ledger(i);
    EXPECT_LT(std::abs(ledger.energy_residual()), 1e-12 * ledger.energy_start);
    EXPECT_LT(std::abs(ledger.momentum_residual()), 1e-12 * ledger.momentum_start);
    EXPECT_NEAR(heat[i] / (physics::heat_partition(plates.soft, plates.hard) * ledger.friction_work), 1.0, 1e-12);
    EXPECT_NEAR(column.answer().interface_temperature[i] - 300.0, heat[i] / capacity, 1e-9);
  }
}

TEST(CoulombTresca, AnOpenInterfaceCarriesNothing) {
  const Plates plates({100.0}, -1e9, guest::FAR_END_TRANSMITTING);
  ShearColumn column(plates.problem);
  hydro::CoulombTrescaLaw law = plates.law();
  for (int step = 0; step < 50; ++step) {
    column.advance(law);
    ASSERT_EQ(column.answer().shear_stress[0], 0.0);
    ASSERT_EQ(column.answer().regime[0], static_cast<std::uint8_t>(wire::Regime::kOpen));
    ASSERT_EQ(column.soft().velocity_at(0)[0], 100.0);
  }
}

}  // namespace
}  // namespace shearbus
