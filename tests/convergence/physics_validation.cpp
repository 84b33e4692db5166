// The model against numbers that others measured or simulated, as tests/measured.toml lists them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "server/physics/material/strength.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

// Jin et al. 2025: the shock melting of aluminium at 125 GPa was observed at 4576 K, with a standard deviation of 235 K.
TEST(PhysicsValidation, AluminiumMeltsAtTheMeasuredTemperature) {
  Material aluminium = make_material("aluminium_6061_t6", {}).material;
  aluminium.melting_curve = MeltingCurve::kLindemann;
  const double T_melt = at_pressure(aluminium, 125e9).melting_temperature;
  std::printf("T_melt(125 GPa) of aluminium by Lindemann: %.0f K; measured 4576 +- 235 K\n", T_melt);
  EXPECT_NEAR(T_melt, 4576.0, 2 * 235.0);
}

// Hammerberg et al. 2011 and 2008: in molecular dynamics between two thermostats the critical velocity falls as one over
// the size, and is linear in the temperature over T_melt. A layer between its interface and a face at T_far slides
// steadily with s v = k_tot (T0 - T_far)/L, so the velocity at which T0 reaches a share of T_melt is exactly of this form.
TEST(PhysicsValidation, TheCriticalVelocityFallsAsOneOverSizeAndIsLinearInTheTemperature) {
  constexpr double kShare = 0.9;
  ModelOptions options = graded(paper_options(), 20, 1.1);
  options.soft.hardening_coefficient = 0.0;
  options.grid.far_boundary = FarBoundary::kIsothermal;
  const double T_c = kShare * options.soft.melting_temperature;
  const double s_c = flow_stress(options.soft, 0.0, 11.2e9, T_c) / kSqrt3;
  for (const double size : {5e-6, 10e-6, 20e-6}) {
    for (const double T_far : {300.0, 600.0, 900.0}) {
      options.grid.thickness = size;
      options.initial_temperature = T_far;
      Rig rig(options, 1);
      const double conductance = options.soft.conductivity / size / rig.conducted_share();
      const double critical = conductance * (T_c - T_far) / s_c;
      rig.set_all(critical, 11.2e9);
      for (int n = 0; n < 400; ++n) rig.step(0.1 * size * size / options.soft.diffusivity);
      EXPECT_NEAR(rig.T(0), T_c, 1e-6) << size << " m, " << T_far << " K";
      EXPECT_NEAR(rig.stress() / s_c, 1.0, 1e-9);
      std::printf("L %4.1f um, T_far %3.0f K: critical velocity %.3f m/s\n", size * 1e6, T_far, critical);
    }
  }
}

// Irfan and Prakash 2000: Ti-6Al-4V on tool steel at 1.5 GPa and up to 60 m/s, interface temperatures up to 800 C. Two
// half-spaces heated by the power s v reach T - T_start = 2 s v sqrt(t/pi) / e, with the sum e of their effusivities
// sqrt(k rho c). A slip of 1 us at 60 m/s then heats by 780 K if the friction coefficient is 0.13.
TEST(PhysicsValidation, ThePlateExperimentReachesItsTemperatureAtItsFriction) {
  constexpr double kFriction = 0.13, kPressure = 1.5e9, kVelocity = 60.0, kDt = 1e-9;
  ModelOptions options = graded(paper_options());
  options.drive = Drive::kInterfaceSlip;
  options.soft = make_material("titanium_6al_4v", {}).material;
  options.hard = make_material("steel_4340", {}).material;
  options.friction_coefficient = kFriction;
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  Rig rig(options, 1);
  rig.set_all(kVelocity, kPressure);
  for (int n = 0; n < 1000; ++n) rig.step(kDt);
  const auto effusivity = [](const Material& m) { return m.conductivity / std::sqrt(m.diffusivity); };
  const double e = effusivity(options.soft) + effusivity(options.hard);
  const double heating = 2 * kFriction * kPressure * kVelocity * std::sqrt(1e-6 / M_PI) / e;
  std::printf("plate experiment: T0 %.1f K after 1 us, s %.1f MPa; exact %.1f K\n", rig.T(0), rig.stress() / 1e6,
              300.0 + heating);
  EXPECT_NEAR(rig.stress() / (kFriction * kPressure), 1.0, 1e-12);
  EXPECT_NEAR((rig.T(0) - 300.0) / heating, 1.0, 0.01);
  EXPECT_NEAR(rig.T(0), 273.15 + 800.0, 25.0);
}

// Hammerberg et al. 2022, molecular dynamics of aluminium: the friction force grows with the sliding velocity until the
// interface reaches T_melt(P), and falls as a power of the velocity above. An interface held at T_melt between
// half-spaces takes up the power s v = e (T_melt - T_start) / sqrt(pi t), so that our power is -1.
TEST(PhysicsValidation, TheForceGrowsUpToMeltingAndFallsAsAPowerOfTheVelocityAbove) {
  constexpr double kVelocities[kLanes] = {5.0, 20.0, 50.0, 100.0, 150.0, 300.0, 600.0, 1000.0};
  ModelOptions options = graded(paper_options());
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  Rig rig(options);
  rig.set_all(0.0, 11.2e9);
  std::copy_n(kVelocities, kLanes, rig.inputs.velocity_jump);
  double before = 0.0;
  for (const double t : {0.1e-6, 1e-6}) {
    for (; before < t - 0.5e-9; before += 1e-9) rig.step(1e-9);
    int hottest_growing = 0;
    for (int l = 0; l < kLanes; ++l) {
      std::printf("%.1f us, %4.0f m/s: s %6.1f MPa, T0 %6.1f K\n", t * 1e6, kVelocities[l], rig.stress(l) / 1e6,
                  rig.T(0, l));
      if (l == 0) continue;
      if (rig.T(0, l) < 0.8 * options.soft.melting_temperature) {
        EXPECT_GT(rig.stress(l), rig.stress(l - 1)) << t << " s, " << kVelocities[l] << " m/s";
        hottest_growing = l;
      } else if (rig.T(0, l - 1) > 0.99 * options.soft.melting_temperature) {
        EXPECT_LT(rig.stress(l), rig.stress(l - 1)) << t << " s, " << kVelocities[l] << " m/s";
      }
    }
    EXPECT_GE(hottest_growing, 2);
    const double power = std::log(rig.stress(7) / rig.stress(6)) / std::log(kVelocities[7] / kVelocities[6]);
    std::printf("%.1f us: s falls as the velocity to the power %.3f\n", t * 1e6, power);
    EXPECT_NEAR(power, -1.0, t < 0.5e-6 ? 0.05 : 0.02);
  }
}

}  // namespace
}  // namespace shearbus::testing
