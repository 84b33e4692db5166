// The elastic shear column against exact solutions, with interface laws for which they exist.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "hydro_stub/shear_column.hpp"
#include "proto/wire/status.hpp"
#include "tests/support/hydro_laws.hpp"
#include "tests/support/refused.hpp"

namespace shearbus {
namespace {

using hydro::ShearColumn;
using test::aluminium_on_steel;
using test::ConstantFrictionLaw;

double jump(const ShearColumn& column, std::size_t i = 0) {
  return column.soft().velocity_at(0)[i] - column.hard().velocity_at(0)[i];
}

// Aluminium on steel with friction stress s = 50 MPa and initial jump V0 = 100 m/s. With the impedances Z of the bodies
// the jump is [V] = V0 - s (1/Z_soft + 1/Z_hard).
TEST(ShearColumn, ConstantFrictionGivesTheExactJumpFromTheFirstInstant) {
  ShearColumn column(aluminium_on_steel({100.0}, 50));
  ConstantFrictionLaw law(50e6);
  const double exact = 100.0 - 50e6 * (1.0 / std::sqrt(2703.0 * 27.6e9) + 1.0 / std::sqrt(7900.0 * 77e9));
  EXPECT_NEAR(exact, 92.184, 5e-4);
  for (int step = 0; step < 1000; ++step) {  // waves cross the columns 20 times: none may return from a far end
    column.advance(law);
    ASSERT_NEAR(jump(column), exact, 1e-9) << "step " << step;
  }
}

// A plate of impedance Z rubs at one face, with friction stress s; its back is free. At every return of the wave from
// the back the velocity of the rubbing face falls by 2 s / Z.
TEST(ShearColumn, FinitePlateSlowsByTwiceTheWaveAtEveryReturn) {
  hydro::ColumnProblem problem = aluminium_on_steel({100.0}, 200);
  problem.soft.far_end = guest::FAR_END_FREE;
  ShearColumn column(problem);
  ConstantFrictionLaw law(50e6);
  const double round_trip = 2.0 * 2e-3 / problem.soft.wave_speed();
  EXPECT_NEAR(round_trip, 1.251781e-6, 5e-13);
  for (const double expected : {94.211, 82.633, 71.056}) {
    const double first = column.soft().velocity_at(0)[0];
    do {
      column.advance(law);
      EXPECT_NEAR(column.soft().velocity_at(0)[0], expected, 6e-4) << "at " << column.time();
    } while (column.step() % 400 != 0);
    if (expected < 94.0) {
      EXPECT_NEAR(first - column.soft().velocity_at(0)[0], 2.0 * 50e6 / problem.soft.impedance(), 1e-6);
    }
  }
}

TEST(ShearColumn, BondedBodiesMoveTogetherAndCarryTheStressOfTheJump) {
  ShearColumn column(aluminium_on_steel({20.0}, 40));
  ConstantFrictionLaw law(test::kBonded);
  const double exact = 20.0 / (1.0 / std::sqrt(2703.0 * 27.6e9) + 1.0 / std::sqrt(7900.0 * 77e9));
  for (int step = 0; step < 400; ++step) {
    column.advance(law);
    ASSERT_EQ(jump(column), 0.0);
    ASSERT_NEAR(column.answer().shear_stress[0] / exact, 1.0, 1e-12) << "step " << step;
  }
}

TEST(ShearColumn, BothVelocitiesLeaveTheJumpTheLawAnswered) {
  ShearColumn column(aluminium_on_steel({100.0, -37.0, 400.0}, 30));
  ConstantFrictionLaw law(150e6);
  for (int step = 0; step < 200; ++step) {
    column.advance(law);
    for (std::size_t i = 0; i < 3; ++i)
      ASSERT_NEAR(jump(column, i), column.answer().velocity_jump_new[i], 1e-12 * 400.0);
  }
}

TEST(ShearColumn, SwappedSidesOfTheJumpMirrorEveryBit) {
  ShearColumn column(aluminium_on_steel({100.0, -100.0}, 37, 2e-3, 0.8));
  ConstantFrictionLaw law(90e6);
  for (int step = 0; step < 300; ++step) {
    column.advance(law);
    ASSERT_EQ(jump(column, 0), -jump(column, 1));
    ASSERT_EQ(column.answer().shear_stress[0], -column.answer().shear_stress[1]);
  }
}

TEST(ShearColumn, ColumnsDoNotKnowEachOther) {
  const std::vector<double> jumps = {3.0, 20.0, -55.0, 100.0, 250.0, 400.0, 17.0};
  ShearColumn together(aluminium_on_steel(jumps, 23, 2e-3, 0.9));
  ConstantFrictionLaw law(120e6);
  for (int step = 0; step < 200; ++step) together.advance(law);
  for (std::size_t i = 0; i < jumps.size(); ++i) {
    ShearColumn alone(aluminium_on_steel({jumps[i]}, 23, 2e-3, 0.9));
    for (int step = 0; step < 200; ++step) alone.advance(law);
    for (std::size_t j = 0; j <= 23; ++j) {
      ASSERT_EQ(alone.soft().velocity_at(j)[0], together.soft().velocity_at(j)[i]);
      ASSERT_EQ(alone.hard().velocity_at(j)[0], together.hard().velocity_at(j)[i]);
    }
    ASSERT_EQ(alone.ledger(0).energy_end, together.ledger(i).energy_end);
  }
}

// Momentum and energy are conserved for any law, Courant number and far end. This law returns random stresses, whose
// work has either sign.
class RandomTraction : public hydro::InterfaceLaw {
 public:
  void advance(const hydro::InterfaceInputs& in, hydro::InterfaceAnswer& out) override {
    for (std::size_t i = 0; i < in.velocity_jump.size(); ++i) {
      const hydro::FreeJump free = hydro::free_jump(in, i);
      out.shear_stress[i] = std::uniform_real_distribution(-3e8, 3e8)(random_);
      out.velocity_jump_new[i] = free.jump - out.shear_stress[i] * free.compliance;
    }
  }
  hydro::LawTime time_spent() const override { return {}; }

 private:
  std::mt19937_64 random_{20240229};
};

TEST(ShearColumn, LedgersCloseToRoundingForAnyLaw) {
  for (const double courant : {1.0, 0.9, 0.4}) {
    for (const guest::FarEnd end : {guest::FAR_END_FREE, guest::FAR_END_TRANSMITTING}) {
      hydro::ColumnProblem problem = aluminium_on_steel({100.0, 20.0, -400.0}, 60, 2e-3, courant);
      problem.soft.far_end = end;
      problem.hard.far_end = end;
      RandomTraction random;
      ConstantFrictionLaw constant(80e6);
      for (hydro::InterfaceLaw* law :
           {static_cast<hydro::InterfaceLaw*>(&random), static_cast<hydro::InterfaceLaw*>(&constant)}) {
        ShearColumn column(problem);
        for (int step = 0; step < 1000; ++step) column.advance(*law);
        for (std::size_t i = 0; i < 3; ++i) {
          const ShearColumn::Ledger ledger = column.ledger(i);
          const double moved = std::abs(ledger.friction_work) + std::abs(ledger.work_of_far_ends) + ledger.energy_start;
          EXPECT_LT(std::abs(ledger.momentum_residual()), 1e-12 * std::abs(ledger.momentum_start)) << courant;
          EXPECT_LT(std::abs(ledger.energy_residual()), 1e-11 * moved) << courant;
          EXPECT_NE(ledger.friction_work, 0.0);
        }
      }
    }
  }
}

// Largest velocity error of a free plate of length L and wave speed c in its second standing wave, V = cos(2 pi z / L)
// cos(2 pi c t / L), after 1.3 periods L / c.
double standing_wave_error(std::size_t zones, double courant) {
  hydro::ColumnProblem problem = aluminium_on_steel({0.0}, zones, 2e-3, courant);
  problem.soft.far_end = guest::FAR_END_FREE;
  ShearColumn column(problem);
  ConstantFrictionLaw law(test::kFreeSlip);
  const double wave = 2.0 * std::numbers::pi / 2e-3;
  const double frequency = wave * problem.soft.wave_speed();
  const auto shape = [&](std::size_t j) { return std::cos(wave * problem.soft.zone_width * static_cast<double>(j)); };
  for (std::size_t j = 0; j <= zones; ++j) column.soft().velocity_at(j)[0] = shape(j);
  const double end = 1.3 * 2e-3 / problem.soft.wave_speed();
  while (column.time() < end) column.advance(law);
  double worst = 0.0;
  for (std::size_t j = 0; j <= zones; ++j) {
    const double exact = shape(j) * std::cos(frequency * column.time());
    worst = std::max(worst, std::abs(column.soft().velocity_at(j)[0] - exact));
  }
  return worst;
}

TEST(ShearColumn, SmoothWavesConvergeWithSecondOrder) {
  std::printf("  zones   error (Courant number 0.5)   ratio\n");
  double coarser = 0.0;
  for (const std::size_t zones : {25U, 50U, 100U, 200U}) {
    const double error = standing_wave_error(zones, 0.5);
    std::printf("  %5zu   %.3e                    %.3f\n", zones, error, coarser > 0.0 ? error / coarser : 0.0);
    if (coarser > 0.0) {
      EXPECT_NEAR(error / coarser, 0.25, 0.02);
    }
    coarser = error;
  }
  EXPECT_LT(coarser, 1e-3);
  EXPECT_LT(standing_wave_error(50, 1.0), 2e-3);
}

// A transmitting far end reflects a known part of a wave, which depends on the wavelength and on the Courant number.
// This part is measured with a wave packet of 16 zones per wavelength; at Courant number 1 it is 0.
TEST(ShearColumn, TransmittingEndReflectsOnlyWhatItStates) {
  constexpr std::size_t kZones = 1280;
  constexpr std::size_t kStart = 960;  // zone at which the packet starts; half of it travels each way
  for (const double courant : {1.0, 0.7}) {
    ShearColumn column(aluminium_on_steel({0.0}, kZones, 2e-3, courant));
    const double half_k = std::numbers::pi / 16.0;
    for (std::size_t j = 0; j <= kZones; ++j) {
      const double x = static_cast<double>(j) - static_cast<double>(kStart);
      column.soft().velocity_at(j)[0] = std::exp(-x * x / 3600.0) * std::cos(2.0 * half_k * x);
    }
    ConstantFrictionLaw law(test::kFreeSlip);
    const int steps =
        // Number of steps in which one half of the packet travels to the far end and back to the middle of the column.
        static_cast<int>(640.0 / courant);
    for (int step = 0; step < steps; ++step) column.advance(law);
    double reflected = 0.0;
    for (std::size_t j = 640; j <= kZones; ++j)
      reflected = std::max(reflected, std::abs(column.soft().velocity_at(j)[0]));
    const double half_w = std::asin(courant * std::sin(half_k));
    const double stated = 0.5 * std::abs(std::cos(half_k) - std::cos(half_w)) / (std::cos(half_k) + std::cos(half_w));
    EXPECT_NEAR(reflected, stated, 0.1 * stated + 1e-12) << "Courant number " << courant;
  }
}

class FaultyLaw : public ConstantFrictionLaw {
 public:
  FaultyLaw() : ConstantFrictionLaw(50e6) {}
  void advance(const hydro::InterfaceInputs& in, hydro::InterfaceAnswer& out) override {
    ConstantFrictionLaw::advance(in, out);
    if (in.step == 3) fault(out);
  }
  std::function<void(hydro::InterfaceAnswer&)> fault;
};

TEST(ShearColumn, AnAnswerThatIsNoneStopsTheRunAndNamesTheNode) {
  FaultyLaw law;
  const std::function<void(hydro::InterfaceAnswer&)> faults[] = {
      [](hydro::InterfaceAnswer& out) { out.shear_stress[1] = std::nan(""); },
      [](hydro::InterfaceAnswer& out) { out.velocity_jump_new[1] = HUGE_VAL; },
      [](hydro::InterfaceAnswer& out) { out.interface_temperature[1] = std::nan(""); },
      [](hydro::InterfaceAnswer& out) { out.regime[1] = 5; }};
  for (const auto& fault : faults) {
    law.fault = fault;
    ShearColumn column(aluminium_on_steel({100.0, 50.0}, 10));
    column.advance(law);
    column.advance(law);
    const wire::Status refused = support::fault_of([&] { column.advance(law); });
    EXPECT_EQ(refused.node_ids, std::vector<std::uint64_t>{1});
    EXPECT_NE(refused.text.find("step 3"), std::string::npos) << refused.text;
  }
}

}  // namespace
}  // namespace shearbus
