// Melting temperature and pressure hardening as functions of the compression eta(P).
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

Material aluminium() {
  return paper_options().soft;
}

TEST(PhysicsPressure, CompressionIsOnTheHugoniot) {
  for (const char* name : {"aluminium_dlp", "aluminium_2024_t4", "steel_304"}) {
    const Material m = make_material(name, {}).material;
    EXPECT_EQ(compression_at(m, 0.0), 1.0);
    EXPECT_EQ(compression_at(m, -1e9), 1.0);
    for (double P : {1e3, 1e9, 11.2e9, 100e9, 1e12}) {
      const double x = 1.0 - 1.0 / compression_at(m, P);
      const double slower = 1.0 - m.hugoniot_slope * x;
      EXPECT_NEAR(m.density * m.sound_speed * m.sound_speed * x / (slower * slower) / P, 1.0, P < 1e6 ? 1e-7 : 1e-11)
          << name << ", " << P;
    }
  }
}

TEST(PhysicsPressure, MeltingTemperatureIsSteinbergs) {
  Material m = aluminium();
  // a material without a melting curve has a constant T_melt
  EXPECT_EQ(at_pressure(m, 11.2e9).melting_temperature, 1220.0);
  m.melting_curve = MeltingCurve::kLindemann;
  EXPECT_NEAR(at_pressure(m, 11.2e9).melting_temperature, 1743.4, 0.1);
  EXPECT_EQ(at_pressure(m, 0.0).melting_temperature, 1220.0);
  double before = 1220.0;
  for (double P = 1e9; P < 200e9; P *= 1.5) {
    EXPECT_GT(at_pressure(m, P).melting_temperature, before);
    before = at_pressure(m, P).melting_temperature;
  }
  // For small x = P / (rho0 c0^2): T_melt / T_melt(0) - 1 = 2 a x + 2 (gamma0 - a - 1/3) x = 2 (gamma0 - 1/3) x, with
  // the volume correction a of the Grueneisen coefficient.
  const double slope = (at_pressure(m, 1e6).melting_temperature / 1220.0 - 1.0) / 1e6;
  EXPECT_NEAR(slope * 2703 * 5240 * 5240 / (2 * (1.97 - 1.0 / 3.0)), 1.0, 1e-4);
}

TEST(PhysicsPressure, TheCompressedTermDividesByTheCubeRootOfEta) {
  Material m = aluminium();
  m.pressure_term = PressureTerm::kCompressed;
  const double eta = compression_at(m, 11.2e9);
  EXPECT_NEAR(eta, 1.12175, 1e-5);
  EXPECT_NEAR(at_pressure(m, 11.2e9).pressure_coefficient / (6.52e-11 / std::cbrt(eta)), 1.0, 1e-14);
  EXPECT_NEAR(softening(m, 11.2e9, 300.0).g / softening(aluminium(), 11.2e9, 300.0).g,
              (1 + 6.52e-11 * 11.2e9 / std::cbrt(eta)) / (1 + 6.52e-11 * 11.2e9), 1e-12);
  EXPECT_EQ(softening(m, 0.0, 500.0).g, softening(aluminium(), 0.0, 500.0).g);
}

// `at_pressure` replaces the pressure-dependent options of a material by constants. A second call must not change the
// material again.
TEST(PhysicsPressure, AMaterialAtItsPressureIsItself) {
  Material m = aluminium();
  m.melting_curve = MeltingCurve::kLindemann;
  m.pressure_term = PressureTerm::kCompressed;
  const Material once = at_pressure(m, 20e9);
  EXPECT_FALSE(once.varies_with_compression());
  EXPECT_EQ(at_pressure(once, 20e9).melting_temperature, once.melting_temperature);
  EXPECT_EQ(flow_stress(once, 0.1, 20e9, 900.0), flow_stress(m, 0.1, 20e9, 900.0));
}

TEST(PhysicsPressure, TheConstantTheyNeedIsNamed) {
  Material m = aluminium();
  m.grueneisen = kNotGiven;
  EXPECT_EQ(constant_missing_for_options(m), "");
  m.pressure_term = PressureTerm::kCompressed;
  EXPECT_EQ(constant_missing_for_options(m), "");
  m.melting_curve = MeltingCurve::kLindemann;
  EXPECT_EQ(constant_missing_for_options(m), "grueneisen_coefficient");
  m.sound_speed = kNotGiven;
  EXPECT_EQ(constant_missing_for_options(m), "sound_speed_m_per_s");
}

// Simon's curve T0 (1 + P/a)^(1/c), with constants of the size of aluminium's.
TEST(PhysicsPressure, SimonsCurveIsThatOfItsFormula) {
  Material m = aluminium();
  m.simon_temperature = 933.45;
  m.simon_pressure = 6.049e9;
  EXPECT_EQ(constant_missing_for_options(m), "");
  choose_melting_curve(m, MeltingCurve::kSimon);
  EXPECT_EQ(constant_missing_for_options(m), "simon_exponent");
  m.simon_exponent = 1.0 / 0.531;
  EXPECT_EQ(constant_missing_for_options(m), "");
  EXPECT_EQ(m.melting_temperature, 933.45);
  for (const double P : {2e9, 11.2e9, 125e9})
    EXPECT_NEAR(at_pressure(m, P).melting_temperature, 933.45 * std::pow(1.0 + P / 6.049e9, 0.531), 1e-9);
  EXPECT_NEAR(at_pressure(m, 2e9).melting_temperature, 1086.0, 1.0);
  EXPECT_NEAR(at_pressure(m, 11.2e9).melting_temperature, 1628.0, 1.0);
  EXPECT_NEAR(at_pressure(m, 125e9).melting_temperature, 4779.0, 1.0);
  EXPECT_EQ(at_pressure(m, -3e9).melting_temperature, 933.45);
  const Material once = at_pressure(m, 20e9);
  EXPECT_FALSE(once.varies_with_compression());
  EXPECT_EQ(at_pressure(once, 20e9).melting_temperature, once.melting_temperature);
  EXPECT_EQ(flow_stress(once, 0.1, 20e9, 900.0), flow_stress(m, 0.1, 20e9, 900.0));
  // The compression is needed by the pressure term only.
  m.sound_speed = kNotGiven;
  EXPECT_EQ(constant_missing_for_options(m), "");
  EXPECT_GT(at_pressure(m, 20e9).melting_temperature, 1900.0);
  m.pressure_term = PressureTerm::kCompressed;
  EXPECT_EQ(constant_missing_for_options(m), "sound_speed_m_per_s");
}

// Runs a soft body with and without a melting curve at 1000 m/s and 11.2 GPa. `T_melt`: that of the curve, which
// `highest` bounds from above. The interface stays just below its melting temperature, and the stress s is proportional
// to the melting temperature minus the initial temperature.
void expect_pinned(const Material& curved, double T_melt, double highest) {
  ModelOptions options = graded(paper_options());
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  Rig constant(options, 1);
  options.soft = curved;
  Rig pinned(options, 1);
  for (Rig* rig : {&constant, &pinned}) {
    rig->set_all(1000.0, 11.2e9);
    for (int n = 0; n < 1000; ++n) rig->step(1e-9);
  }
  EXPECT_NEAR(pinned.stress() / constant.stress(), (T_melt - 300) / (1220 - 300), 0.003);
  EXPECT_LT(pinned.T(0), highest);
  EXPECT_EQ(pinned.outputs.regime[0], Regime::kMelting);
}

TEST(PhysicsPressure, AnInterfaceIsPinnedAtSimonsCurve) {
  Material soft = paper_options().soft;
  soft.simon_temperature = 933.45;
  soft.simon_pressure = 6.049e9;
  soft.simon_exponent = 1.0 / 0.531;
  choose_melting_curve(soft, MeltingCurve::kSimon);
  expect_pinned(soft, 1628.2, 1628.5);
}

TEST(PhysicsPressure, ThePinnedStressFollowsTheMeltingCurve) {
  Material soft = paper_options().soft;
  soft.melting_curve = MeltingCurve::kLindemann;
  expect_pinned(soft, 1743.4, 1743.4);
}

// The pressure falls so far that the interface is hotter than its melting temperature: the interface carries no stress,
// and no friction heats it.
TEST(PhysicsPressure, ReleaseCanMeltTheInterface) {
  for (Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    ModelOptions options = graded(paper_options(strategy));
    options.soft.melting_curve = MeltingCurve::kLindemann;
    Rig rig(options, 1);
    rig.start({1500.0, 1500.0, 1500.0, 1500.0, 1500.0, 1500.0, 1500.0, 1500.0});
    rig.set_all(50.0, 11.2e9);
    rig.step(1e-9);
    EXPECT_GT(rig.stress(), 0.0);
    const double T0 = rig.T(0);
    rig.set_all(50.0, 1e9);
    rig.step(1e-9);
    EXPECT_EQ(rig.stress(), 0.0);
    EXPECT_EQ(rig.outputs.friction_heat[0], 0.0);
    EXPECT_LE(rig.T(0), T0);
    EXPECT_EQ(rig.outputs.regime[0], Regime::kMelting);
  }
}

}  // namespace
}  // namespace shearbus::testing
